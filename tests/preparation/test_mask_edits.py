"""The record of written masks: it tells edits from what was written, and a damaged one removes no file."""

import json
from pathlib import Path

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.mask_edits import RECORD, MaskEdits


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    files = [tmp_path / "stage" / name for name in ("a.png", "b.png")]
    files[0].parent.mkdir()
    for file in files:
        file.write_text(f"picture or mask {file.name}")
    return files


def found(tmp_path: Path, pictures: list[Path]) -> MaskEdits:
    return MaskEdits.find(tmp_path / "capture", tmp_path, pictures)


def test_only_what_was_changed_counts_as_edited(tmp_path: Path, pictures: list[Path]):
    found(tmp_path, pictures).write({"masks": pictures})
    assert found(tmp_path, pictures).edited == ()
    (tmp_path / "capture" / "masks" / "b.png").write_text("painted")
    edits = found(tmp_path, pictures)
    assert edits.edited == ("masks/b.png",)
    chosen = edits.chosen("masks", [pictures[0], None, pictures[1]])
    assert chosen.files == (pictures[0], None, tmp_path / "capture" / "masks" / "b.png")
    assert chosen.present() == [pictures[0], tmp_path / "capture" / "masks" / "b.png"]
    # Stages that read the masks are done again when the user's change, and not otherwise.
    assert chosen.inputs == edits.chosen("masks", pictures).inputs != {}
    assert edits.chosen("masks", [pictures[0]]).inputs == edits.chosen("person_masks", pictures).inputs == {}


@pytest.mark.parametrize(
    "name", ["../mine", "masks/../../mine", "/mine", "mine", "images/a.png", "masks/", "masks/..", "masks/x/a.png"]
)
def test_a_record_never_leads_out_of_the_masks(tmp_path: Path, pictures: list[Path], name: str):
    mine = tmp_path / "mine"
    mine.write_text("mine")
    row = {"picture": "0", "digests": ["0"]}
    (tmp_path / RECORD).write_text(json.dumps({name.replace("/mine", str(mine)) if name == "/mine" else name: row}))
    with pytest.raises(InputError, match=r"written_masks\.json: expected names of masks, such as .*; keep copies"):
        found(tmp_path, pictures)
    assert mine.read_text() == "mine"


@pytest.mark.parametrize(
    "text", ["", "[]", "{", '{"masks/a.png": []}', '{"masks/a.png": {"picture": 3, "digests": []}}', "\x00", "[" * 9999]
)
def test_a_damaged_record_is_one_sentence(tmp_path: Path, pictures: list[Path], text: str):
    (tmp_path / RECORD).write_text(text)
    with pytest.raises(InputError, match=r"written_masks\.json: .*expected .*remove this file; all masks are then"):
        found(tmp_path, pictures)
