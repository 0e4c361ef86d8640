import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from neural_strands.capture.checks import check_capture
from neural_strands.capture.findings import Finding, worst
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.hairline import scalp_faces

SIZE = 96
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1))
CUBE += "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\nf 2 6 8\nf 2 8 4\n"


def texture(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).random((SIZE, SIZE, 3))
    return (255 * noise).astype(np.uint8)


def hair_of_the_cube(camera: Camera) -> np.ndarray:
    """A mask of what a camera sees of the cube's scalp, two pixels wider all around."""
    rows = [line.split() for line in CUBE.splitlines()]
    vertices = torch.tensor([[float(x) for x in row[1:]] for row in rows if row[0] == "v"])
    faces = torch.tensor([[int(x) - 1 for x in row[1:]] for row in rows if row[0] == "f"])
    seen = rasterise_triangles(vertices, faces, camera).face
    hair = torch.isin(seen, scalp_faces(Mesh(vertices, faces)))
    return cv2.dilate(hair.numpy().astype(np.uint8) * 255, np.ones((5, 5), np.uint8))


def write_dome(folder: Path, views: int = 24, arc: float = 2 * math.pi, scale: float = 1.0) -> Path:
    """A good capture: cameras all around at two heights, noise for images, a cube for a head, its top as hair."""
    frames = []
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    for k in range(views):
        turn, lift = arc * k / views, (0.15, 0.8)[k % 2]
        eye = torch.tensor([math.sin(turn) * math.cos(lift), math.sin(lift), math.cos(turn) * math.cos(lift)])
        camera = Camera.look_at(eye, torch.zeros(3), 2.0 * SIZE, (SIZE, SIZE))
        pose = camera.opengl_camera_to_world.clone()
        pose[:3, 3] *= scale
        cv2.imwrite(str(folder / f"images/{k:03}.png"), texture(k))
        cv2.imwrite(str(folder / f"masks/{k:03}.png"), hair_of_the_cube(camera))
        frames.append({"file_path": f"images/{k:03}.png", "transform_matrix": pose.double().tolist()})
    shared = {"w": SIZE, "h": SIZE, "fl_x": 2.0 * SIZE, "cx": SIZE / 2, "cy": SIZE / 2}
    (folder / "transforms.json").write_text(json.dumps(shared | {"frames": frames}))
    (folder / "head.obj").write_text(CUBE)
    return folder


def found(folder: Path) -> dict[str, Finding]:
    return {finding.topic: finding for finding in check_capture(folder)}


def test_a_good_capture_has_no_warning(tmp_path):
    findings = found(write_dome(tmp_path / "c"))
    assert worst(list(findings.values())) == "note"
    assert {topic for topic, finding in findings.items() if finding.level == "note"} == {
        "person masks",
        "head",
        "ground truth",
    }


def test_files_missing_unreadable_and_of_another_size(tmp_path):
    folder = write_dome(tmp_path / "c")
    (folder / "images/003.png").unlink()
    (folder / "images/004.png").write_bytes(b"\x89PNG nothing")
    cv2.imwrite(str(folder / "masks/005.png"), np.zeros((7, 7), np.uint8))
    problems = [finding.message for finding in check_capture(folder) if finding.topic == "files"]
    assert len(problems) == 3
    for name, problem in zip(("003.png", "004.png", "005.png"), problems, strict=True):
        assert name in problem
    assert worst(check_capture(folder)) == "error"


def test_empty_full_and_missing_masks(tmp_path):
    folder = write_dome(tmp_path / "c")
    cv2.imwrite(str(folder / "masks/002.png"), np.zeros((SIZE, SIZE), np.uint8))
    assert found(folder)["hair masks"].views == ("002.png",)
    cv2.imwrite(str(folder / "masks/002.png"), np.full((SIZE, SIZE), 255, np.uint8))
    assert "whole image" in found(folder)["hair masks"].message
    (folder / "masks/002.png").unlink()
    assert "missing" in found(folder)["hair masks"].message


def test_blur_and_exposure(tmp_path):
    folder = write_dome(tmp_path / "c")
    cv2.imwrite(str(folder / "images/007.png"), cv2.GaussianBlur(texture(7), (0, 0), 2.0))
    cv2.imwrite(str(folder / "images/010.png"), texture(10) // 3)
    findings = found(folder)
    assert findings["sharpness"].views == ("007.png",)
    assert findings["exposure"].views == ("010.png",)


def test_a_camera_that_looks_away(tmp_path):
    folder = write_dome(tmp_path / "c")
    document = json.loads((folder / "transforms.json").read_text())
    pose = np.array(document["frames"][6]["transform_matrix"])
    pose[:3, :3] = pose[:3, :3] @ np.diag([-1.0, 1.0, -1.0])
    document["frames"][6]["transform_matrix"] = pose.tolist()
    document["frames"][9]["transform_matrix"] = document["frames"][8]["transform_matrix"]
    (folder / "transforms.json").write_text(json.dumps(document))
    findings = found(folder)
    assert findings["aim"].views == ("006.png",)
    assert findings["poses"].views == ("009.png",)


@pytest.mark.parametrize("with_head", [True, False])
def test_scale_that_is_not_metres(tmp_path, with_head):
    folder = write_dome(tmp_path / "c", scale=100.0)
    if with_head:
        (folder / "head.obj").write_text(CUBE.replace("0.1", "10"))
    else:
        (folder / "head.obj").unlink()
    finding = found(folder)["scale"]
    assert finding.level == ("error" if with_head else "warning")
    assert finding.action


def test_a_narrow_range_and_few_views(tmp_path):
    assert "narrow" in found(write_dome(tmp_path / "narrow", arc=math.radians(60)))["viewpoints"].message
    assert "few" in found(write_dome(tmp_path / "few", views=6))["viewpoints"].message


def all_black(folder: Path, kind: str) -> None:
    for path in (folder / kind).iterdir():
        assert cv2.imwrite(str(path), np.zeros((SIZE, SIZE), np.uint8))


def one_pose(folder: Path) -> None:
    document = json.loads((folder / "transforms.json").read_text())
    for frame in document["frames"]:
        frame["transform_matrix"] = document["frames"][0]["transform_matrix"]
    (folder / "transforms.json").write_text(json.dumps(document))


def two_views(folder: Path) -> None:
    document = json.loads((folder / "transforms.json").read_text())
    document["frames"] = document["frames"][:2]
    (folder / "transforms.json").write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("topic", "words", "spoil"),
    [
        ("viewpoints", "needs 3 views or more: 2 views", two_views),
        ("poses", "all views have the same pose", one_pose),
        ("sharpness", "no image has any detail", lambda folder: all_black(folder, "images")),
        ("hair masks", "all 24 are empty", lambda folder: all_black(folder, "masks")),
        ("head", "no head mesh", lambda folder: (folder / "head.obj").unlink()),
        (
            "head",
            "without any area",
            lambda folder: (folder / "head.obj").write_text("v 0.1 0 0\n" * 8 + CUBE[CUBE.index("f ") :]),
        ),
    ],
)
def test_what_no_fit_can_use_is_an_error(tmp_path, topic, words, spoil):
    folder = write_dome(tmp_path / "c")
    spoil(folder)
    finding = found(folder)[topic]
    assert finding.level == "error"
    assert words in finding.message
    assert finding.action


def test_blank_images_among_others_are_named(tmp_path):
    folder = write_dome(tmp_path / "c")
    cv2.imwrite(str(folder / "images/004.png"), np.full((SIZE, SIZE, 3), 90, np.uint8))
    finding = found(folder)["sharpness"]
    assert (finding.level, finding.views) == ("warning", ("004.png",))


def test_a_broken_head_and_truth_are_rows(tmp_path):
    folder = write_dome(tmp_path / "c")
    (folder / "head.obj").write_text("v 0 0\n")
    (folder / "ground_truth.npz").write_bytes(b"nothing")
    findings = found(folder)
    assert findings["head"].level == findings["ground truth"].level == "error"


def test_a_real_capture_is_fit_for_use(shared_data):
    assert worst(check_capture(shared_data / "captures" / "straight_long")) == "note"


def test_the_real_photographs_lack_what_they_lack(shared_data):
    warned = {f.topic for f in check_capture(shared_data / "photos" / "face") if f.level == "warning"}
    assert warned == {"hair masks", "scale", "viewpoints"}
