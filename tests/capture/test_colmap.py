import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from neural_strands.capture.capture import Capture
from neural_strands.capture.colmap import (
    read_cameras_binary,
    read_cameras_text,
    read_images_binary,
    read_images_text,
)
from neural_strands.foundation.errors import InputError

NUMBERS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4}
CAMERAS = {
    1: ("SIMPLE_PINHOLE", 64, 48, [50.0, 32.0, 24.0]),
    2: ("PINHOLE", 48, 64, [50.0, 51.0, 24.5, 32.5]),
    3: ("SIMPLE_RADIAL", 64, 48, [50.0, 32.0, 24.0, 0.01]),
    7: ("RADIAL", 64, 48, [50.0, 32.0, 24.0, 0.01, -0.02]),
    9: ("OPENCV", 64, 48, [50.0, 52.0, 31.0, 25.0, 0.01, -0.02, 0.003, 0.004]),
}
HALF = 0.5**0.5
IMAGES = [
    (4, [HALF, 0.0, HALF, 0.0], [0.1, 0.2, 3.0], 9, "b 2.png", [(1.0, 2.0, -1)]),
    (2, [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0], 1, "a.png", []),
]


def write_text(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"{k} {name} {w} {h} {' '.join(map(str, p))}" for k, (name, w, h, p) in CAMERAS.items()]
    (folder / "cameras.txt").write_text("# Camera list\n" + "\n".join(lines) + "\n")
    text = "# Image list\n"
    for identity, quaternion, translation, camera, name, points in IMAGES:
        text += f"{identity} {' '.join(map(str, quaternion + translation))} {camera} {name}\n"
        text += " ".join(f"{x} {y} {p}" for x, y, p in points) + "\n"
    (folder / "images.txt").write_text(text)


def write_binary(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    content = struct.pack("<Q", len(CAMERAS))
    for identity, (name, width, height, parameters) in CAMERAS.items():
        content += struct.pack("<IiQQ", identity, NUMBERS[name], width, height)
        content += struct.pack(f"<{len(parameters)}d", *parameters)
    (folder / "cameras.bin").write_bytes(content)
    content = struct.pack("<Q", len(IMAGES))
    for identity, quaternion, translation, camera, name, points in IMAGES:
        content += struct.pack("<I7dI", identity, *quaternion, *translation, camera) + name.encode() + b"\0"
        content += struct.pack("<Q", len(points)) + b"".join(struct.pack("<ddq", *point) for point in points)
    (folder / "images.bin").write_bytes(content)


@pytest.mark.parametrize("place", ["sparse/0", "sparse", "."])
@pytest.mark.parametrize("write", [write_text, write_binary])
def test_text_and_binary_models_give_the_cameras(tmp_path, write, place):
    write(tmp_path / place)
    capture = Capture.load(tmp_path)
    assert [camera.name for camera in capture.cameras] == ["a.png", "b 2.png"]
    first, second = capture.cameras
    assert (first.width, first.height) == (64, 48)
    torch.testing.assert_close(first.position, torch.tensor([0.0, 0.0, -2.0]))
    # A quarter turn about y: (x, y, z) -> (z, y, -x), then the translation.
    torch.testing.assert_close(second.transform(torch.tensor([1.0, 2.0, 3.0])), torch.tensor([3.1, 2.2, 2.0]))
    assert first.intrinsics.tolist() == [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]
    assert second.intrinsics[:2, 2].tolist() == [31.0, 25.0]


def test_every_model_becomes_opencvs_coefficients(tmp_path):
    write_text(tmp_path)
    write_binary(tmp_path)
    text, binary = read_cameras_text(tmp_path / "cameras.txt"), read_cameras_binary(tmp_path / "cameras.bin")
    assert text == binary
    assert text[3].coefficients == (0.01, 0.0, 0.0, 0.0, 0.0)
    assert text[7].coefficients == (0.01, -0.02, 0.0, 0.0, 0.0)
    assert text[9].coefficients == (0.01, -0.02, 0.003, 0.004, 0.0)
    assert text[9].intrinsics == (50.0, 52.0, 31.0, 25.0)
    assert text[2].intrinsics == (50.0, 51.0, 24.5, 32.5)
    assert read_images_text(tmp_path / "images.txt") == read_images_binary(tmp_path / "images.bin")


@settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_cut_or_spoilt_files_are_refused_or_read_never_worse(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("model")
    write_text(folder)
    write_binary(folder)
    readers = {
        "cameras.txt": read_cameras_text,
        "images.txt": read_images_text,
        "cameras.bin": read_cameras_binary,
        "images.bin": read_images_binary,
    }
    name = data.draw(st.sampled_from(list(readers)))
    content = bytearray((folder / name).read_bytes())
    cut = data.draw(st.integers(0, len(content)))
    content = content[:cut]
    if content:
        for place, value in data.draw(
            st.lists(st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), max_size=3)
        ):
            content[place] = value
    (folder / name).write_bytes(bytes(content))
    message = name
    try:
        readers[name](folder / name)
    except InputError as error:
        message = str(error)
    assert name in message


def test_a_count_of_four_billion_is_refused_before_anything_is_allocated(tmp_path):
    write_binary(tmp_path)
    content = (tmp_path / "images.bin").read_bytes()
    (tmp_path / "images.bin").write_bytes(struct.pack("<Q", 2**32) + content[8:])
    with pytest.raises(InputError, match=r"images.bin: expected a count that fits .* at byte 0, found 4294967296"):
        read_images_binary(tmp_path / "images.bin")
    (tmp_path / "images.bin").write_bytes(content[:-5])
    with pytest.raises(InputError, match="at byte"):
        read_images_binary(tmp_path / "images.bin")


def test_unknown_models_and_cameras_are_one_sentence(tmp_path):
    write_text(tmp_path)
    lines = (tmp_path / "cameras.txt").read_text()
    (tmp_path / "cameras.txt").write_text(lines.replace("OPENCV", "FISHEYE"))
    with pytest.raises(InputError, match="FISHEYE"):
        Capture.load(tmp_path)
    (tmp_path / "cameras.txt").write_text(lines.replace("9 OPENCV", "8 OPENCV"))
    with pytest.raises(InputError, match="listed in cameras, found 9"):
        Capture.load(tmp_path)
    (tmp_path / "images.txt").unlink()
    with pytest.raises(InputError, match=r"images\.txt"):
        Capture.load(tmp_path)


def test_masks_are_found_beside_colmap_images(tmp_path):
    import cv2

    write_text(tmp_path / "sparse")
    for name, folder in (("a.png", "images"), ("a.png", "masks"), ("a.png.png", "person_masks")):
        (tmp_path / folder).mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / folder / name), np.full((48, 64), 255, np.uint8))
    capture = Capture.load(tmp_path)
    assert capture.image(0).shape == (48, 64, 3)
    assert capture.hair_mask(0).min() == capture.person_mask(0).min() == 1
    assert capture.hair_mask(1) is None
