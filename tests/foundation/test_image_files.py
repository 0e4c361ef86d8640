"""The headers of images are checked without decoding anything."""

import io
import struct
import zlib
from pathlib import Path

import pytest
from damage import EDIT, damage, fuzz, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.image_files import image_size


def encoded(kind: str, size: tuple[int, int] = (7, 5)) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", size, (200, 100, 50)).save(buffer, kind)
    return buffer.getvalue()


def png(width: int, height: int, padding: int = 0) -> bytes:
    """A PNG whose header claims this size, with a single byte of pixels and some bytes behind it."""

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0") + bytes(padding))
        + chunk(b"IEND", b"")
    )


def test_a_chunk_that_claims_more_than_the_file_has_is_refused(tmp_path):
    whole = encoded("PNG")
    place = whole.index(b"IDAT") - 4
    for length in (0x8415002B, len(whole) - place - 11):
        claim = whole[:place] + struct.pack(">I", length) + whole[place + 4 :]
        assert "expected a complete image of 7 x 5" in read_or_refuse(tmp_path / "a.png", claim, image_size)
    # What follows the last chunk belongs to no image.
    assert read_or_refuse(tmp_path / "a.png", whole + bytes(5), image_size) == ""


@pytest.mark.parametrize("mode", ["1", "L", "P", "LA", "RGB", "RGBA", "I;16"])
def test_the_emptiest_png_of_each_mode_is_accepted(tmp_path, mode):
    Image.new(mode, (2000, 1500)).save(tmp_path / "a.png", optimize=True)
    assert image_size(tmp_path / "a.png") == (2000, 1500)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "BMP"])
def test_sizes_of_formats(tmp_path, kind):
    (tmp_path / "a").write_bytes(encoded(kind))
    assert image_size(tmp_path / "a") == (7, 5)


def test_a_large_image_costs_nothing(tmp_path):
    whole = png(14_000, 11_000, padding=14_000 * 11_000 * 3 // 1032)
    assert read_or_refuse(tmp_path / "a.png", whole, image_size, most=1_000_000) == ""
    assert image_size(tmp_path / "a.png") == (14_000, 11_000)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (png(30_000, 30_000), "at most 160000000 pixels"),
        (png(14_000, 12_000), "at most 160000000 pixels, found 14000 x 12000; resize it"),
        (png(2**31 - 1, 2**31 - 1), "expected an image"),
        (png(0, 5), "expected an image"),
        (png(14_000, 11_000), "expected a complete image of 14000 x 11000 pixels, found only 66 bytes"),
        (b"", "such as PNG or JPEG"),
        (b"no image", "such as PNG or JPEG"),
        (png(7, 5)[:20], "such as PNG or JPEG"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path, content, message):
    assert message in read_or_refuse(tmp_path / "a.png", content, image_size, most=1_000_000)


def test_no_file(tmp_path):
    assert "found a folder" in refusal_of(tmp_path)
    assert "found nothing there" in refusal_of(tmp_path / "a.png")


def refusal_of(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        image_size(path)
    return str(caught.value)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP", "TIFF", "BMP"])
@fuzz(80)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(kind: str, tmp_path: Path, edits: list):
    read_or_refuse(tmp_path / "a", damage(encoded(kind), edits), image_size, most=20_000_000)
