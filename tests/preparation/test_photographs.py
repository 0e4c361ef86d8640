"""Photographs from a folder: upright, sRGB, small enough, with unique names, without the damaged ones."""

import struct
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from fuzzed_input import give
from PIL import Image, ImageOps

from neural_strands.capture.images import colour_of, read_pixels, to_unit
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.photographs.folder import (
    MOST_PIXELS,
    find_photographs,
    import_photographs,
    read_list,
    read_picture,
    unread_pictures,
    write_picture,
)
from neural_strands.preparation.photographs.metadata import EXIF, FOCAL_35MM, MAKE, ORIENTATION


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


@pytest.mark.parametrize(
    ("orientation", "upright"),
    [
        # By the standard, where the stored picture's first row and first column belong: top and left, top and right,
        # bottom and right, bottom and left, left and top, right and top, right and bottom, left and bottom.
        (1, "rg bw"),
        (2, "gr wb"),
        (3, "wb gr"),
        (4, "bw rg"),
        (5, "rb gw"),
        (6, "br wg"),
        (7, "wg br"),
        (8, "gw rb"),
    ],
)
@pytest.mark.parametrize("suffix", ["jpg", "tif", "png"])
def test_corners_of_a_known_picture_are_where_its_orientation_says(
    tmp_path: Path, orientation: int, upright: str, suffix: str
):
    colours = {"r": (255, 0, 0), "g": (0, 255, 0), "b": (0, 0, 255), "w": (255, 255, 255)}
    fill(tmp_path)
    # Twice as wide as high: red and green above, blue and white below.
    corners = np.array([[colours["r"], colours["g"]], [colours["b"], colours["w"]]], np.uint8)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(corners.repeat(16, 0).repeat(32, 1)).save(tmp_path / f"a.{suffix}", exif=exif)
    run(tmp_path, tmp_path / "out")
    found = read_picture(tmp_path / "out" / "a.png").astype(int)
    height, width = (64, 32) if orientation > 4 else (32, 64)
    assert found.shape == (height, width, 3)
    for row, names in enumerate(upright.split()):
        for column, name in enumerate(names):
            pixel = found[height // 4 + row * height // 2, width // 4 + column * width // 2]
            assert np.abs(pixel - colours[name]).max() < 8, (row, column, name)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_turned_as_pillow_turns_it(tmp_path: Path, orientation: int):
    fill(tmp_path)
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    random = np.random.default_rng(0).integers(0, 256, (40, 60, 3), dtype=np.uint8)
    Image.fromarray(random).save(tmp_path / "a.png", exif=exif)
    run(tmp_path, tmp_path / "out")
    with Image.open(tmp_path / "a.png") as stored:
        expected = np.asarray(ImageOps.exif_transpose(stored))
    np.testing.assert_array_equal(read_picture(tmp_path / "out" / "a.png"), expected)


def test_unusual_metadata_cost_no_photograph(tmp_path: Path):
    fill(tmp_path)
    exif = Image.Exif()
    exif[ORIENTATION], exif[MAKE] = 6, "Maker"
    Image.fromarray(picture()).save(tmp_path / "a.jpg", exif=exif, quality=95)
    content = (tmp_path / "a.jpg").read_bytes()
    make = struct.pack(">HHL", MAKE, 2, len("Maker") + 1)
    assert content.count(make) == 1
    # The make as a floating-point number: Pillow reads it, but cannot write it again.
    (tmp_path / "a.jpg").write_bytes(content.replace(make, struct.pack(">HHL", MAKE, 11, 1)))
    with Image.open(tmp_path / "a.jpg") as stored, pytest.raises(AttributeError):
        ImageOps.exif_transpose(stored)
    found, said = run(tmp_path, tmp_path / "out")
    assert [(photograph.width, photograph.height) for photograph in found if photograph.source == "a.jpg"] == [(40, 60)]
    assert said == []


@pytest.mark.parametrize("cut", [0.5, 0.8, 0.95])
def test_cut_heic_files_are_left_out(tmp_path: Path, cut: float):
    fill(tmp_path)
    content = heic(tmp_path)
    (tmp_path / "a.heic").write_bytes(content[: int(cut * len(content))])
    found, said = run(tmp_path, tmp_path / "out")
    assert len(found) == 3
    assert len(said) == 1
    assert said[0].startswith("a.heic does not decode (")


def test_heic_is_read_whatever_its_suffix(tmp_path: Path):
    fill(tmp_path)
    (tmp_path / "a.JPG").write_bytes(heic(tmp_path))
    # Another test may have enabled Pillow to read HEIC.
    kept = Image.OPEN.pop("HEIF", None), [name for name in Image.ID if name != "HEIF"]
    Image.ID[:] = kept[1]
    found, said = run(tmp_path, tmp_path / "out")
    assert said == []
    assert [photograph.source for photograph in found if photograph.name == "a.png"] == ["a.JPG"]
    difference = read_picture(tmp_path / "out" / "a.png").astype(int) - np.kron(picture(), np.ones((4, 4, 1)))
    assert np.abs(difference).mean() < 8


@pytest.mark.slow(seconds=12)
def test_photographs_of_the_largest_sensors_are_read_and_larger_claims_are_not(
    tmp_path: Path, recwarn: pytest.WarningsRecorder
):
    fill(tmp_path)
    assert MOST_PIXELS >= 16320 * 12240
    with Image.open(tmp_path / "plain0.png") as small:
        small.convert("1").resize((16320, 12240)).save(tmp_path / "large.png")
    content = bytearray((tmp_path / "plain0.png").read_bytes())
    content[16:24] = struct.pack(">II", 20_000, 20_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "larger.png").write_bytes(content)
    found, said = run(tmp_path, tmp_path / "out", longest_side=160)
    assert {(photograph.width, photograph.height) for photograph in found if "large" in photograph.name} == {(160, 120)}
    assert [sentence.split()[0] for sentence in said] == ["larger.png"]
    assert not recwarn.list


def heic(folder: Path) -> bytes:
    """The picture, four times as large, as HEIC."""
    pillow_heif = pytest.importorskip("pillow_heif")
    path = folder / "picture.tmp"
    pixels = np.kron(picture(), np.ones((4, 4, 1), np.uint8))
    pillow_heif.from_pillow(Image.fromarray(pixels)).save(path, format="HEIF", quality=95)
    return path.read_bytes()


def test_large_pictures_shrink_and_alpha_lies_over_black(tmp_path: Path):
    fill(tmp_path)
    Image.fromarray(picture(80, 120)).save(tmp_path / "large.bmp")
    clear = np.dstack([picture(), np.zeros((40, 60), np.uint8)])
    Image.fromarray(clear).save(tmp_path / "clear.webp", lossless=True)
    Image.fromarray(np.full((40, 60, 4), (255, 255, 255, 128), np.uint8)).save(tmp_path / "half.png")
    Image.fromarray(np.full((40, 60), 257 * 100, np.uint16)).save(tmp_path / "deep.png")
    found, _ = run(tmp_path, tmp_path / "out", longest_side=60)
    assert {(photograph.width, photograph.height) for photograph in found} == {(60, 40)}
    assert not read_picture(tmp_path / "out" / "clear.png").any()
    half = 255 * (1.055 * (128 / 255) ** (1 / 2.4) - 0.055)
    assert (read_picture(tmp_path / "out" / "half.png") == round(half)).all()
    assert (read_picture(tmp_path / "out" / "deep.png") == 100).all()


@pytest.mark.parametrize("suffix", ["png", "tif"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_sixteen_bits_keep_their_brightness(tmp_path: Path, suffix: str, channels: int):
    """From black to white in every channel, and in a capture that names the same file."""
    fill(tmp_path)
    shape = (8, 64) if channels == 1 else (8, 64, 3)
    deep = np.linspace(0, 65535, int(np.prod(shape))).round().astype(np.uint16).reshape(shape)
    if channels == 4:
        deep = np.dstack([deep, np.full(shape[:2], 65535, np.uint16)])
    # OpenCV orders blue, green, red.
    stored = deep if channels == 1 else deep[..., [2, 1, 0, 3][:channels]]
    assert cv2.imwrite(str(tmp_path / f"deep.{suffix}"), np.ascontiguousarray(stored))
    _, said = run(tmp_path, tmp_path / "out")
    assert said == []
    expected = np.broadcast_to(deep[..., None] if channels == 1 else deep[..., :3], (8, 64, 3)) / 65535
    found = read_picture(tmp_path / "out" / "deep.png") / 255
    assert np.abs(found - expected).max() <= 1 / 255
    in_capture = to_unit(colour_of(read_pixels(tmp_path / f"deep.{suffix}")))
    np.testing.assert_allclose(in_capture, expected, atol=1e-4)


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_samples_whose_white_is_unknown_are_left_out_and_named(tmp_path: Path, kind: type):
    fill(tmp_path)
    Image.fromarray(np.ones((40, 60), kind)).save(tmp_path / "raw.tif")
    found, said = run(tmp_path, tmp_path / "out")
    assert len(found) == 3
    assert len(said) == 1
    assert said[0].startswith("raw.tif does not decode (expected 8 or 16 bits per sample, found 32 ")
    with pytest.raises(InputError, match="expected 8 or 16 bits per sample, found"):
        read_pixels(tmp_path / "raw.tif")


def test_pictures_of_other_formats_are_named(tmp_path: Path):
    for name in ("b.exr", "a.EXR", "c.dng", ".d.exr", "notes.txt"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"found 0; export 'a\.EXR' and 2 more as JPEG\.$"):
        find_photographs(tmp_path)
    fill(tmp_path)
    assert unread_pictures(tmp_path) == "'a.EXR' and 2 more"
    # A raw file beside the JPEG that the camera wrote with it.
    (tmp_path / "plain0.dng").touch()
    assert unread_pictures(tmp_path) == "'a.EXR' and 2 more"
    for name in ("b.exr", "c.dng"):
        (tmp_path / name).unlink()
    assert unread_pictures(tmp_path) == "'a.EXR'"
    (tmp_path / "a.EXR").unlink()
    assert unread_pictures(tmp_path) == ""


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


def test_photographs_in_folders_inside_are_pointed_out(tmp_path: Path):
    for name in (".thumbnails", "empty", "side"):
        (tmp_path / name).mkdir()
    (tmp_path / "album.jpg").mkdir()
    fill(tmp_path / ".thumbnails")
    fill(tmp_path / "side")
    with pytest.raises(InputError, match=r"found 0; name .*side or move all photographs of the person into one folder"):
        find_photographs(tmp_path)
    fill(tmp_path)
    assert [path.name for path in find_photographs(tmp_path)] == ["plain0.png", "plain1.png", "plain2.png"]


def test_a_folder_that_may_not_be_read_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(_: Path):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "iterdir", refuse)
    with pytest.raises(InputError, match=r"found one that cannot be read \(Operation not permitted\); allow it"):
        find_photographs(tmp_path)


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
