"""A template head: a mesh with a scalp, and the face's landmarks on it.

Landmarks of any template come from the face detector itself: the mesh is rendered from several frontal views, and the
rays through the landmarks detected in these renderings are intersected with the mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import ArraySpec
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, interpolate, vertex_normals
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.face.topology import INTERIOR, LANDMARKS
from neural_strands.preparation.head.files import head_arrays, head_of, read_head_arrays
from neural_strands.preparation.head.flame import read_flame
from neural_strands.preparation.photographs.folder import write_picture
from neural_strands.raster.triangles import TriangleBuffer, rasterise_triangles
from neural_strands.scalp.chart import chart_faces
from neural_strands.scalp.hairline import measure_head, scalp_faces
from neural_strands.scalp.head import Head
from neural_strands.scalp.load import load_head

BUST = 0.42
"""Length below the crown that is kept of a whole body, metres."""
SIZE = 640
"""Side of the renderings, pixels."""
DISTANCE = 0.7
SPAN = 0.42
"""Distance of the renderings' cameras, and width that they show at the face, metres."""
VIEWS = tuple(
    (azimuth, elevation) for elevation in (-12.0, 0.0, 12.0) for azimuth in (-30.0, -18.0, -6.0, 6.0, 18.0, 30.0)
)
"""Azimuth and elevation of the views from which the template is rendered, degrees."""
SKIN, BACKGROUND = (0.80, 0.60, 0.50), (0.35, 0.38, 0.42)
LIGHT = (0.35, 0.55, 0.75)
"""Direction to the light."""
AMBIENT = 0.35
FACING = 0.3
"""Least cosine between normal and line of sight for a landmark's ray to be used."""
FEWEST_VIEWS = 3
NEAR_LANDMARK = 0.012
"""Distance from a landmark within which the template counts as face, metres."""
FILE = "template.npz"
Paint = Callable[[Float[Tensor, "point 3"]], Float[Tensor, "point 3"]]
"""Colours, linear RGB, of points on a head's surface."""


@dataclass(frozen=True)
class Template:
    """A head to be fitted.

    Attributes:
        head: metres, y up, +z out of the face, with the crown near (0, 0.12, 0).
        landmarks: positions on the head's surface, metres; NaN if unknown.
        spread: median deviation of the views for each landmark, metres; NaN if unknown.
    """

    head: Head
    landmarks: Float[Tensor, "landmark 3"]
    spread: Float[Tensor, " landmark"]

    def save(self, folder: Path) -> None:
        """Write `template.npz`."""
        arrays = {"spread": self.spread.numpy(), **head_arrays(self.head, self.landmarks)}
        np.savez(folder / FILE, allow_pickle=False, **arrays)

    @classmethod
    def load(cls, folder: Path) -> "Template":
        """Read what `save` wrote.

        Raises:
            InputError: the file is missing or damaged.
        """
        spread = ArraySpec("spread", str(LANDMARKS), np.float32, finite=False)
        arrays = read_head_arrays(folder / FILE, "a template", (spread,))
        return cls(*head_of(arrays), torch.from_numpy(arrays["spread"]))


def bust(head: Head) -> Head:
    """Cut a head or a whole body below the shoulders, and move the origin between the ears."""
    measure = measure_head(head.mesh.vertices)
    vertices = head.mesh.vertices - (measure.crown - torch.tensor([0.0, 0.12, 0.0]))
    kept = (vertices[head.mesh.faces][..., 1] > 0.12 - BUST).all(dim=1)
    faces = head.mesh.faces[kept]
    used = torch.unique(faces)
    number = torch.full((len(vertices),), -1)
    number[used] = torch.arange(len(used))
    face_number = torch.cumsum(kept, 0) - 1
    uv = None if head.mesh.corner_uv is None else head.mesh.corner_uv[kept]
    on_bust = kept[head.scalp_faces]
    scalp = face_number[head.scalp_faces[on_bust]]
    return Head(Mesh(vertices[used], number[faces], uv), scalp, head.scalp_uv[on_bust])


def load_template(path: Path, scalp: Path | None) -> Head:
    """Read a template: any mesh that `scalp.load.load_head` reads, or FLAME's pickle.

    Raises:
        InputError: a file is missing or malformed.
    """
    if path.suffix.lower() not in (".pkl", ".pickle"):
        return bust(load_head(path, scalp))
    if scalp is not None:
        raise InputError(f"{scalp}: expected no --scalp with FLAME's model, found one; leave it out.")
    mesh = read_flame(path)
    chosen = scalp_faces(mesh)
    return bust(Head(mesh, chosen, chart_faces(mesh, chosen)))


def skin(points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
    """The same skin colour everywhere."""
    return torch.tensor(SKIN).expand(len(points), 3)


def find_landmarks(head: Head, detector: Detector, folder: Path, name: str, paint: Paint = skin) -> Template:
    """Detect a head's landmarks in renderings of it, which are left in `folder`.

    Args:
        head: the head as `bust` returns it.
        detector: finds faces.
        folder: an existing folder.
        name: name of the head in messages.
        paint: colours of the head in the renderings.

    Raises:
        InputError: the detector failed, or found no face in most renderings.
    """
    cameras = [_camera(*view) for view in VIEWS]
    buffers, pictures = [], []
    for camera in cameras:
        buffer = rasterise_triangles(head.mesh.vertices, head.mesh.faces, camera)
        buffers.append(buffer)
        pictures.append(folder / f"{camera.name}.png")
        write_picture(pictures[-1], draw(head.mesh, camera, buffer, paint))
    faces = detector.detect(pictures, description="finding the template's face")
    cast = [
        _cast(head.mesh, camera, buffer, torch.from_numpy(found[0]).float())
        for camera, buffer, found in zip(cameras, buffers, faces, strict=True)
        if found
    ]
    if len(cast) < FEWEST_VIEWS:
        raise InputError(
            f"{name}: expected a head whose face the detector recognises, found one in {len(cast)} of {len(cameras)} "
            "renderings of it; give a template with eyes, nose and mouth (y up, +z out of the face)."
        )
    landmarks, spread = _agreed(torch.stack(cast))
    known = torch.isfinite(landmarks).all(dim=1)
    on_surface = closest_points(landmarks[known], head.mesh).position
    landmarks[known] = on_surface
    return Template(head, landmarks, spread)


def draw(mesh: Mesh, camera: Camera, buffer: TriangleBuffer, paint: Paint = skin) -> np.ndarray:
    """Render a mesh simply: 8-bit RGB, one lamp and some ambient light."""
    normals = vertex_normals(mesh)[mesh.faces]
    face = buffer.face.clamp(min=0).view(-1)
    weights = buffer.barycentric.view(-1, 3)
    normal = torch.nn.functional.normalize(interpolate(normals, face, weights), dim=-1)
    light = torch.nn.functional.normalize(camera.rotation.T @ torch.tensor([LIGHT[0], -LIGHT[1], -LIGHT[2]]), dim=0)
    shade = AMBIENT + (1.0 - AMBIENT) * (normal @ light).clamp(min=0.0)
    colour = paint(interpolate(mesh.corners(), face, weights)) * shade[:, None]
    colour = torch.where((buffer.face.view(-1) >= 0)[:, None], colour, torch.tensor(BACKGROUND))
    return (colour.view(camera.height, camera.width, 3) ** (1 / 2.2) * 255).round().to(torch.uint8).numpy()


def _camera(azimuth: float, elevation: float) -> Camera:
    turn = torch.deg2rad(torch.tensor([azimuth, elevation]))
    direction = torch.stack([turn[0].sin() * turn[1].cos(), turn[1].sin(), turn[0].cos() * turn[1].cos()])
    target = torch.tensor([0.0, -0.01, 0.03])
    focal = SIZE * DISTANCE / SPAN
    name = f"{azimuth:+03.0f}{elevation:+03.0f}"
    return Camera.look_at(target + DISTANCE * direction, target, focal, (SIZE, SIZE), name)


def _cast(
    mesh: Mesh, camera: Camera, buffer: TriangleBuffer, pixels: Float[Tensor, "landmark 2"]
) -> Float[Tensor, "landmark 3"]:
    """Intersect the rays through landmarks with the mesh; NaN where they miss or graze it."""
    inside = (pixels.nan_to_num(-1.0) >= 0).all(dim=1) & (pixels.nan_to_num(1e9) < SIZE).all(dim=1)
    column, row = pixels.nan_to_num(0.0).floor().long().clamp(0, SIZE - 1).unbind(dim=1)
    face, depth = buffer.face[row, column], buffer.depth[row, column]
    corners = mesh.corners()[face.clamp(min=0)]
    normal = torch.nn.functional.normalize(
        torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), dim=-1
    )
    facing = -(normal * camera.rays(pixels)).sum(dim=-1)
    hit = inside & (face >= 0) & (facing > FACING)
    points = camera.unproject(pixels, depth)
    return torch.where(hit[:, None], points, torch.nan)


def _agreed(cast: Float[Tensor, "view landmark 3"]) -> tuple[Float[Tensor, "landmark 3"], Float[Tensor, " landmark"]]:
    """Median of each landmark over the views, and the median distance of the views from it."""
    middle = cast.nanmedian(dim=0).values
    away = (cast - middle).norm(dim=-1)
    spread = away.nanmedian(dim=0).values
    few = torch.isfinite(cast).all(dim=-1).sum(dim=0) < FEWEST_VIEWS
    middle[few], spread[few] = torch.nan, torch.nan
    return middle, spread


def near_landmarks(
    vertices: Float[Tensor, "vertex 3"], landmarks: Float[Tensor, "landmark 3"]
) -> Bool[Tensor, " vertex"]:
    """Mark the vertices of the face: those near a landmark that stays in place on the skin. All in metres."""
    marks = landmarks[list(INTERIOR)]
    marks = marks[torch.isfinite(marks).all(dim=1)]
    return torch.cdist(vertices, marks).amin(dim=1) < NEAR_LANDMARK


def rescaled(template: Template, factor: float) -> Template:
    """Scale a template about its origin."""
    head = template.head.transformed(factor, torch.eye(3), torch.zeros(3))
    return replace(template, head=head, landmarks=factor * template.landmarks, spread=factor * template.spread)
