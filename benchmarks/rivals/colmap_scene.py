"""Writes cameras and first points as a COLMAP text model, which programs that fit splats read."""

from collections.abc import Sequence
from pathlib import Path

from scene import SeedPoints
from scipy.spatial.transform import Rotation

from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.cameras import Camera
from neural_strands.pictures.encoding import to_bytes


def write_colmap(folder: Path, cameras: Sequence[Camera], seeds: SeedPoints) -> None:
    """Write `sparse/0` of a folder whose `images` have the cameras' names; each photograph has its own camera.

    Args:
        folder: of the scene.
        cameras: without skew.
        seeds: the points, which no photograph is said to have seen.
    """
    lenses, poses, points = [], [], []
    for number, camera in enumerate(cameras, 1):
        (fx, _, cx), (_, fy, cy), _ = camera.intrinsics.double().tolist()
        lenses.append(f"{number} PINHOLE {camera.width} {camera.height} {fx} {fy} {cx} {cy}")
        x, y, z, w = Rotation.from_matrix(camera.rotation.double().numpy()).as_quat()
        place = " ".join(map(str, camera.world_to_camera[:3, 3].double().tolist()))
        # The second line of a photograph is that of its points.
        poses.append(f"{number} {w} {x} {y} {z} {place} {number} {camera.name}\n")
    colours = to_bytes(seeds.colours).tolist()
    for number, (point, colour) in enumerate(zip(seeds.points.double().tolist(), colours, strict=True), 1):
        points.append(" ".join(map(str, (number, *point, *colour, 0.0))))
    for name, lines in (("cameras", lenses), ("images", poses), ("points3D", points)):
        path = folder / "sparse" / "0" / f"{name}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_file(path) as temporary:
            temporary.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
