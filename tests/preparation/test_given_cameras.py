"""Cameras of other programs: each format against points projected by its own published formulas."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from neural_strands.capture.lens import Lens
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.cameras.calibration import PosedLens, SparsePoints, calibrate
from neural_strands.preparation.cameras.given import read_cameras
from neural_strands.preparation.photographs.folder import Photograph, write_picture

SHOT = Photograph("a.png", "A.JPG", 600, 400)


def image_of(posed: PosedLens, point: np.ndarray) -> np.ndarray:
    local = posed.world_to_camera[:3, :3] @ point + posed.world_to_camera[:3, 3]
    return posed.lens.distort(local[:2] / local[2])


def metashape(camera_to_world: np.ndarray, extra="") -> str:
    matrix = " ".join(f"{value:.17g}" for value in camera_to_world.ravel())
    return f"""<?xml version="1.0"?><document version="1.5.0"><chunk label="Chunk 1">
    <sensors><sensor id="0" label="unknown" type="frame"><resolution width="600" height="400"/>
      <calibration type="frame" class="initial"><resolution width="600" height="400"/><f>1</f></calibration>
      <calibration type="frame" class="adjusted"><resolution width="600" height="400"/><f>700</f><cx>3</cx><cy>-5</cy>
      <k1>0.05</k1><k2>-0.02</k2><k3>0.01</k3><p1>0.002</p1><p2>-0.001</p2><b1>4</b1>{extra}</calibration>
    </sensor></sensors>
    <cameras><camera id="0" sensor_id="0" label="A"><transform>{matrix}</transform></camera>
    <camera id="1" sensor_id="0" label="B"/></cameras></chunk></document>"""


def some_pose() -> np.ndarray:
    angle = 0.3
    pose = np.eye(4)
    pose[:3, :3] = [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    pose[:3, 3] = 0.1, -0.2, 0.3
    return pose


def test_metashape_projects_by_its_manual(tmp_path: Path):
    path = tmp_path / "cameras.xml"
    pose = some_pose()
    path.write_text(metashape(pose))
    found = read_cameras(path, [SHOT])
    assert list(found) == ["A"]
    point = np.array([0.4, 0.1, 3.0])
    # Metashape's manual, appendix "Camera models".
    x, y, depth = pose[:3, :3].T @ (point - pose[:3, 3])
    x, y = x / depth, y / depth
    r2 = x * x + y * y
    radial = 1 + 0.05 * r2 - 0.02 * r2**2 + 0.01 * r2**3
    across = x * radial + 0.002 * (r2 + 2 * x * x) + 2 * -0.001 * x * y
    down = y * radial + -0.001 * (r2 + 2 * y * y) + 2 * 0.002 * x * y
    expected = [600 / 2 + 3 + across * 700 + across * 4, 400 / 2 - 5 + down * 700]
    np.testing.assert_allclose(image_of(found["A"], point), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("<document", "cannot be read as such"),
        ("<document/>", "expected aligned cameras"),
        (metashape(some_pose(), "<k4>0.1</k4>"), "without k4 and b2"),
        (metashape(np.diag([2.0, 1, 1, 1])), "rigid camera pose"),
        (metashape(some_pose()).replace("700", "nan"), "expected finite numbers"),
        (metashape(some_pose()).replace("700", "-1"), "positive size and focal length"),
        (metashape(some_pose()).replace("700", "7e9"), "expected a focal length of 0.01 to 10000.0 image widths"),
        (metashape(some_pose()).replace("0.05", "4e9"), "expected distortion of at most 1000, found 4e"),
        (metashape(some_pose()).replace('type="frame" class="adjusted"', 'type="fisheye" class="adjusted"'), "fisheye"),
    ],
)
def test_wrong_metashape_files_are_one_sentence(tmp_path: Path, text: str, complaint: str):
    path = tmp_path / "cameras.xml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_cameras(path, [SHOT])


def reality_capture(**changes: str) -> str:
    values = {"#name": "A.jpg", "x": "1", "y": "2", "alt": "3", "heading": "90", "pitch": "0", "roll": "0", "f": "42"}
    values |= {"px": "0.6", "py": "-0.3"} | dict.fromkeys(("k1", "k2", "k3", "k4", "t1", "t2"), "0")
    values |= changes
    return ",".join(values) + "\n" + ",".join(values.values()) + "\n"


def test_reality_capture_looks_where_heading_and_pitch_say(tmp_path: Path):
    path = tmp_path / "cameras.csv"
    path.write_text(reality_capture(pitch="90"))
    posed = read_cameras(path, [SHOT])["A.jpg"]
    # A pitch of 0 looks straight down, one of 90 degrees at the horizon; a heading of 90 degrees is east (x).
    rotation = posed.world_to_camera[:3, :3]
    np.testing.assert_allclose(rotation[2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(rotation[1], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(-rotation.T @ posed.world_to_camera[:3, 3], [1, 2, 3], atol=1e-12)
    # 42 mm on 36 mm film, for 600 pixels; the principal point in the same unit.
    assert posed.lens.intrinsics == pytest.approx((700, 700, 310, 195))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a,b\n1,2\n", "found no #name"),
        (reality_capture(f="x"), "finite numbers and a positive focal length"),
        (reality_capture(f="0"), "finite numbers and a positive focal length"),
        (reality_capture(k4="0.1"), "without k4"),
        (reality_capture(px="4e9"), "expected a centre near the image"),
        (reality_capture(k1="4e9"), "expected distortion of at most 1000"),
        (reality_capture(f="4e12"), "expected a focal length of 0.01 to 10000.0 image widths"),
        (reality_capture(**{"#name": "\0\0/A.jpg"}, f="0"), r"'\\x00\\x00/A.jpg': expected finite numbers"),
    ],
)
def test_wrong_reality_capture_files_are_one_sentence(tmp_path: Path, text: str, complaint: str):
    path = tmp_path / "cameras.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_cameras(path, [SHOT])


def test_reality_capture_names_may_tell_the_time(tmp_path: Path):
    path = tmp_path / "cameras.csv"
    head, _, row = reality_capture(f="36").partition("\n")
    times = ["at 14.30.22", "at 14.30.25"]
    path.write_text(head + "\n" + "".join(row.replace("A.jpg", time) for time in times))
    shots = [Photograph(f"{times[0]}.png", f"{times[0]}.jpg", 600, 400)]
    found = read_cameras(path, [*shots, Photograph(f"{times[1]}.png", f"{times[1]}.jpg", 300, 200)])
    assert {name: posed.lens.width for name, posed in found.items()} == {times[0]: 600, times[1]: 300}


def test_transforms_and_colmap_are_read_as_a_capture_reads_them(tmp_path: Path):
    frame = {"file_path": "images/A.JPG", "transform_matrix": (some_pose() @ np.diag([1, -1, -1, 1])).tolist()}
    document = {"w": 600, "h": 400, "fl_x": 700.0, "cx": 303.0, "cy": 195.0, "k1": 0.05, "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    for path in (tmp_path, tmp_path / "transforms.json"):
        posed = read_cameras(path, [SHOT])["A.JPG"]
        np.testing.assert_allclose(np.linalg.inv(posed.world_to_camera), some_pose(), atol=1e-6)
        assert posed.lens.coefficients[0] == 0.05
    with pytest.raises(InputError, match="expected cameras"):
        read_cameras(tmp_path / "cameras.doc", [SHOT])


def test_cameras_of_larger_copies_are_scaled_and_found_by_stem(tmp_path: Path):
    images, out = tmp_path / "images", tmp_path / "out"
    images.mkdir()
    out.mkdir()
    shots = [Photograph(f"{name}.png", f"{name}.JPG", 60, 40) for name in "abcd"]
    for shot in shots:
        write_picture(images / shot.name, np.zeros((40, 60, 3), np.uint8))
    lens = Lens((700.0, 700.0, 303.0, 195.0), (0.0, 0.0, 0.0, 0.0, 0.0), 600, 400)
    said: list[str] = []
    posed = {f"{name}.tiff": PosedLens(lens, some_pose()) for name in "ABC"}
    calibrate(images, shots, posed, SparsePoints.none(), out, said.append)
    document = json.loads((out / "transforms.json").read_text())
    assert [frame["file_path"] for frame in document["frames"]] == ["images/a.png", "images/b.png", "images/c.png"]
    assert document["fl_x"] == pytest.approx(70)
    assert document["cx"] == pytest.approx(30.3)
    assert said == ["No camera for d.JPG: left out."]


def test_photographs_of_another_shape_or_name_are_refused(tmp_path: Path):
    lens = Lens((700.0, 700.0, 303.0, 195.0), (0.0, 0.0, 0.0, 0.0, 0.0), 400, 600)
    shots = [Photograph(f"{name}.png", f"{name}.JPG", 60, 40) for name in "abc"]
    posed = {f"{name}.JPG": PosedLens(lens, some_pose()) for name in "abc"}
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="expected the shape that its camera says"):
        calibrate(tmp_path, shots, posed, SparsePoints.none(), tmp_path / "out", print)
    with pytest.raises(InputError, match="image names must be those of the photographs"):
        calibrate(tmp_path, shots, {"z": posed["a.JPG"]}, SparsePoints.none(), tmp_path / "out", print)
