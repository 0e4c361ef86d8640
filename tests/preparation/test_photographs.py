"""Photographs from a folder: upright, sRGB, small enough, with unique names, without the damaged ones."""

import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from fuzzed_input import give
from PIL import Image

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.photographs.folder import (
    EXIF,
    FOCAL_35MM,
    MAKE,
    find_photographs,
    import_photographs,
    read_list,
    read_picture,
    write_picture,
)

ORIENTATION = 0x0112


def picture(height=40, width=60) -> np.ndarray:
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[: height // 2, : width // 2] = (255, 0, 0)
    pixels[height // 2 :, width // 2 :] = (0, 0, 255)
    return pixels


def fill(folder: Path, count=3) -> None:
    for k in range(count):
        Image.fromarray(picture()).save(folder / f"plain{k}.png")


def run(folder: Path, out: Path, longest_side=2048):
    said: list[str] = []
    out.mkdir()
    return import_photographs(find_photographs(folder), out, longest_side, said.append), said


def test_orientation_focal_length_and_device_come_from_exif(tmp_path: Path):
    fill(tmp_path)
    exif = Image.Exif()
    exif[ORIENTATION], exif[MAKE] = 6, "Maker"
    exif.get_ifd(EXIF)[FOCAL_35MM] = 26
    Image.fromarray(picture()).save(tmp_path / "turned.png", exif=exif)
    found, _ = run(tmp_path, tmp_path / "out")
    turned = next(photograph for photograph in found if photograph.source == "turned.png")
    # Orientation 6: the camera was turned, so the picture must be turned clockwise by 90 degrees.
    assert (turned.width, turned.height) == (40, 60)
    np.testing.assert_array_equal(read_picture(tmp_path / "out" / turned.name), np.rot90(picture(), -1))
    assert turned.device == "Maker"
    # 26 mm on film 43.27 mm across, for a picture 72.11 pixels across.
    assert turned.focal == pytest.approx(26 * np.hypot(40, 60) / np.hypot(36, 24))
    assert read_list(tmp_path / "out") == found


def test_large_pictures_shrink_and_alpha_lies_over_black(tmp_path: Path):
    fill(tmp_path)
    Image.fromarray(picture(80, 120)).save(tmp_path / "large.bmp")
    clear = np.dstack([picture(), np.zeros((40, 60), np.uint8)])
    Image.fromarray(clear).save(tmp_path / "clear.webp", lossless=True)
    Image.fromarray(np.full((40, 60), 257 * 100, np.uint16)).save(tmp_path / "deep.png")
    found, _ = run(tmp_path, tmp_path / "out", longest_side=60)
    assert {(photograph.width, photograph.height) for photograph in found} == {(60, 40)}
    assert not read_picture(tmp_path / "out" / "clear.png").any()
    assert (read_picture(tmp_path / "out" / "deep.png") == 100).all()


def test_names_are_apart_whatever_the_formats(tmp_path: Path):
    fill(tmp_path)
    for suffix in ("png", "bmp"):
        Image.fromarray(picture()).save(tmp_path / f"same.{suffix}")
    found, _ = run(tmp_path, tmp_path / "out")
    assert len({photograph.name for photograph in found}) == len(found) == 5


def test_damaged_files_are_left_out_and_named(tmp_path: Path):
    fill(tmp_path)
    (tmp_path / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe0 no picture")
    whole = (tmp_path / "plain0.png").read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "notes.txt").write_text("no photograph")
    found, said = run(tmp_path, tmp_path / "out")
    assert len(found) == 3
    assert sorted(sentence.split()[0] for sentence in said) == ["broken.jpg", "cut.png"]


def test_too_few_photographs_are_one_sentence(tmp_path: Path):
    with pytest.raises(InputError, match="found nothing"):
        find_photographs(tmp_path / "absent")
    fill(tmp_path, 1)
    with pytest.raises(InputError, match=r"at least 3 photographs .* found 1"):
        find_photographs(tmp_path)
    for name in ("a.jpg", "b.jpg"):
        (tmp_path / name).write_bytes(b"nothing")
    with pytest.raises(InputError, match="at least 3 photographs that decode, found 1"):
        run(tmp_path, tmp_path / "out")


def test_pictures_round_trip(tmp_path: Path):
    write_picture(tmp_path / "a.png", picture())
    np.testing.assert_array_equal(read_picture(tmp_path / "a.png"), picture())
    with pytest.raises(InputError, match="expected a picture of an earlier stage"):
        read_picture(tmp_path / "b.png")


def test_pictures_that_claim_to_be_huge_cost_no_memory(tmp_path: Path):
    path = tmp_path / "a.png"
    write_picture(path, picture())
    content = bytearray(path.read_bytes())
    content[16:24] = struct.pack(">II", 12000, 12000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    path.write_bytes(content)
    outcome = give(read_picture, path)
    assert outcome.kind == "refused", outcome


def test_heic_without_its_package_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    fill(tmp_path)
    (tmp_path / "a.heic").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(InputError, match="expected the package pillow-heif to read HEIC"):
        run(tmp_path, tmp_path / "out")
