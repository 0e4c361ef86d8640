import os

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.input_files import read_bytes, read_text


def test_what_is_there_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"\xef\xbb\xbfna\xc3\xafve")
    assert read_bytes(tmp_path / "a", "a word") == b"\xef\xbb\xbfna\xc3\xafve"
    assert read_text(tmp_path / "a", "a word") == "naïve"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent", "found nothing there; check the path"),
        ("file/below", "cannot be read"),
        ("folder", "found a folder"),
        ("pipe", "found a device or pipe"),
        ("file", "found byte 0xff at 2"),
        ("large", "of at most 10 bytes, found 11"),
        ("a\0b", "cannot be read"),
        ("a" * 300, "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(tmp_path, name, message):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"ab\xff")
    (tmp_path / "large").write_bytes(bytes(11))
    with pytest.raises(InputError, match=message) as caught:
        read_text(tmp_path / name, "a word", most=10)
    assert str(caught.value).startswith(f"{tmp_path / name}: expected a word")


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_file_without_permission(tmp_path):
    (tmp_path / "a").write_text("x")
    (tmp_path / "a").chmod(0)
    with pytest.raises(InputError, match="Permission denied"):
        read_bytes(tmp_path / "a", "a word")
