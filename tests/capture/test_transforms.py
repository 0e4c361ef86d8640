"""`transforms.json` as other programs write it, and as they should not."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from damage import EDIT, damage, fuzz, merged, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st

from neural_strands.capture.capture import Capture
from neural_strands.capture.transforms import read_transforms
from neural_strands.foundation.errors import InputError

DOCUMENT = {
    "camera_model": "OPENCV",
    "w": 16.0,
    "h": 12,
    "fl_x": 50.0,
    "fl_y": 50.5,
    "cx": 8.0,
    "cy": 6.0,
    "k1": 0.01,
    "frames": [{"file_path": "images/a.png", "transform_matrix": np.eye(4).tolist()}],
}


def written(folder: Path, document: object) -> Path:
    path = folder / "transforms.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def frame(**changes: object) -> dict:
    return merged(DOCUMENT, {"frames": [DOCUMENT["frames"][0] | changes]})


def test_what_other_programs_write(tmp_path):
    (view,) = read_transforms(written(tmp_path, DOCUMENT))
    assert (view.camera.width, view.camera.height, view.lens.coefficients[0]) == (16, 12, 0.01)
    # NeRF's synthetic scenes: an angle, no sizes, names without an ending; poses of three rows; null for nothing.
    (tmp_path / "train").mkdir()
    cv2.imwrite(str(tmp_path / "train/r_0.png"), np.zeros((20, 30, 3), np.uint8))
    blender = {"file_path": "./train/r_0", "transform_matrix": np.eye(4)[:3].tolist(), "mask_path": None}
    (view,) = read_transforms(written(tmp_path, {"camera_angle_x": 0.6911112, "k1": None, "frames": [blender]}))
    assert view.image_path == tmp_path / "train/r_0.png"
    assert (view.camera.width, view.camera.height, view.hair_mask_path) == (30, 20, None)
    assert view.lens.intrinsics[0] == pytest.approx(15 / math.tan(0.6911112 / 2))


def test_views_of_the_same_file_name_are_told_apart_by_their_folders(tmp_path):
    frames = [DOCUMENT["frames"][0] | {"file_path": name} for name in ("left/a.png", "right/a.png", "images/b.png")]
    views = read_transforms(written(tmp_path, DOCUMENT | {"frames": frames}))
    assert [view.camera.name for view in views] == ["left/a.png", "right/a.png", "b.png"]
    views = read_transforms(written(tmp_path, DOCUMENT | {"frames": frames[1:]}))
    assert [view.camera.name for view in views] == ["a.png", "b.png"]


WRONG = {
    "nested": ("[" * 100_000, "nested too deeply"),
    "list": ([], "expected an object"),
    "no frames": ({}, "a value under 'frames'"),
    "empty frames": ({"frames": []}, "frames: expected a list of at least one frame"),
    "frame": ({"frames": [5]}, r"frames\[0\]: expected an object"),
    "frames twice": ('{"frames": [], "frames": []}', "the name 'frames' twice"),
    "mask path": (frame(mask_path=5), r"frames\[0\]\.mask_path: expected the path of a file, found 5"),
    "person mask path": (frame(person_mask_path=["a"]), r"frames\[0\]\.person_mask_path: expected the path of a file"),
    "long name": (frame(file_path="a" * 300), r"frames\[0\]\.file_path: expected the path of a file, found 'aaa"),
    "long path": (frame(file_path="a/" * 3000 + "b"), r"frames\[0\]\.file_path: expected the path of a file"),
    "slash": (frame(file_path="/"), r"frames\[0\]\.file_path: expected the path of a file, found '/'"),
    "dots": (frame(file_path=".."), r"frames\[0\]\.file_path: expected the path of a file"),
    "empty": (frame(file_path=""), r"frames\[0\]\.file_path: expected the path of a file"),
    "NUL": (frame(file_path="a\0.png"), r"frames\[0\]\.file_path: expected the path of a file, found 'a\\x00.png'"),
    "line break": (frame(file_path="a\n.png"), r"frames\[0\]\.file_path: expected the path of a file"),
    "half a letter": (frame(file_path="\ud800.png"), r"frames\[0\]\.file_path: expected the path of a file"),
    "k4": (DOCUMENT | {"k4": "a"}, "k4: expected a finite number, found 'a'"),
    "fisheye": (DOCUMENT | {"k4": 0.1}, "k4: expected a lens without k4"),
    "k1": (DOCUMENT | {"k1": 1e300}, r"frames\[0\]: expected distortion of at most 1000, found 1e\+300"),
    "model": (DOCUMENT | {"camera_model": ["OPENCV"]}, "camera_model: expected one of OPENCV"),
    "pose": (frame(transform_matrix=[[10**400, 0, 0, 0]] * 4), r"transform_matrix: expected finite numbers"),
    "pose of text": (frame(transform_matrix=[["1", "0", "0", "0"]] * 4), r"transform_matrix: expected finite numbers"),
    "far pose": (frame(transform_matrix=[[1, 0, 0, 1e30], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), "rigid"),
    "angle": ({"camera_angle_x": 0, "w": 5, "h": 5, "frames": DOCUMENT["frames"]}, "camera_angle_x: expected a finite"),
    "width": (DOCUMENT | {"w": 2**64}, "w: expected a whole number from 1 to 65535, found 18446744073709551616"),
    "half a pixel": (DOCUMENT | {"w": 16.5}, "w: expected a whole number from 1 to 65535, found 16.5"),
    "size": (DOCUMENT | {"w": 65_535, "h": 65_535}, "a positive size of at most 160000000 pixels"),
    "focal": (DOCUMENT | {"fl_x": 0}, r"frames\[0\]: expected a focal length of"),
    "no focal": ({"w": 5, "h": 5, "frames": DOCUMENT["frames"]}, "the focal length under 'fl_x'"),
    "centre": (DOCUMENT | {"cx": -1e9}, "a centre near the image"),
    "infinite": (DOCUMENT | {"cx": math.inf}, "Infinity, which is no number"),
    "no image": ({"fl_x": 5.0, "frames": DOCUMENT["frames"]}, r"a\.png: expected an image, found nothing there"),
}


@pytest.mark.parametrize("name", sorted(WRONG))
def test_what_is_wrong_is_one_sentence(tmp_path, name):
    document, message = WRONG[name]
    with pytest.raises(InputError, match=message) as caught:
        read_transforms(written(tmp_path, document))
    sentence = str(caught.value)
    assert sentence.startswith(str(tmp_path))
    assert sentence.endswith(".")
    assert sentence.isprintable()
    assert len(sentence) < len(str(tmp_path)) + 400


@fuzz(300)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(tmp_path: Path, edits: list):
    def read(path: Path) -> None:
        try:
            read_transforms(path)
        except InputError as error:
            # Without a size, the image is read, but it does not exist.
            raise InputError(f"{path}: {str(error).removeprefix(str(path.parent))}") from error

    read_or_refuse(tmp_path / "transforms.json", damage(json.dumps(DOCUMENT).encode(), edits), read)


def test_an_image_is_not_decoded_where_its_camera_has_another_size(tmp_path):
    """A picture of one colour: 60 kilobytes that would unpack to 75 megabytes."""
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images/a.png"), np.zeros((5000, 5000, 3), np.uint8))
    written(tmp_path, DOCUMENT)
    capture = Capture.load(tmp_path)
    content = (tmp_path / "images/a.png").read_bytes()
    refusal = read_or_refuse(tmp_path / "images/a.png", content, lambda _: capture.image(0), most=2_000_000)
    assert "expected 16 x 12 pixels as its camera says, found 5000 x 5000" in refusal
