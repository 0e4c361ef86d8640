"""A folder belongs to one set of settings, and is continued only with the same settings."""

import json

import pytest
import torch

from neural_strands.capture.writer import CaptureWriter
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.synthesis.resume import claim_folder, differences, is_rendered

SETTINGS = {"style": "wavy", "views": 3, "melanin": {"eumelanin": 0.5}}


def test_a_folder_goes_on_only_with_the_same_settings(tmp_path):
    folder = tmp_path / "capture"
    claim_folder(folder, SETTINGS)
    claim_folder(folder, SETTINGS)
    with pytest.raises(InputError, match=r"views: 3 there, 5 now.*--overwrite"):
        claim_folder(folder, {**SETTINGS, "views": 5})
    (tmp_path / "capture" / "images").mkdir()
    claim_folder(folder, {**SETTINGS, "views": 5}, overwrite=True)
    assert not (tmp_path / "capture" / "images").exists()
    assert json.loads((tmp_path / "capture" / "synthesis.json").read_text())["views"] == 5


def test_a_folder_of_something_else_is_never_touched(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="something else"):
        claim_folder(tmp_path, SETTINGS, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_differences_name_what_changed_appeared_or_went():
    assert differences({"a": 1, "b": 2}, {"a": 1, "b": 3, "c": 4}) == ["b: 2 there, 3 now", "c: None there, 4 now"]
    assert differences({"a": [1]}, {"a": [1]}) == []
    assert differences({"a": 1, "head_digest": "x"}, {"a": 2, "head_digest": "y"}) == ["a: 1 there, 2 now"]
    assert differences({"head_digest": "x"}, {"head_digest": "y"}) == ["head_digest: x there, y now"]


def test_a_view_is_rendered_once_its_three_files_are_there(tmp_path):
    camera = Camera.look_at(torch.ones(3), torch.zeros(3), 10.0, (4, 4), "000")
    half = torch.full((4, 4), 0.5)
    writer = CaptureWriter(tmp_path)
    writer.write_view(camera, half[..., None].expand(-1, -1, 3), half)
    assert not is_rendered(tmp_path, camera)
    writer.write_view(camera, half[..., None].expand(-1, -1, 3), half, half)
    assert is_rendered(tmp_path, camera)


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe", b"[" * 100_000])
def test_a_damaged_record_is_one_sentence_and_stays(tmp_path, content):
    (tmp_path / "synthesis.json").write_bytes(content)
    with pytest.raises(InputError, match=r"synthesis\.json: .*remove the folder, or name another one") as caught:
        claim_folder(tmp_path, SETTINGS, overwrite=True)
    assert "\n" not in str(caught.value)
    assert (tmp_path / "synthesis.json").read_bytes() == content
