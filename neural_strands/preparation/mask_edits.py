"""Masks that the user has edited in a capture: they are kept when the capture is prepared again.

`written_masks.json`, beside the stages, holds the digests of all masks that the program has written into the capture,
and of the picture that each belongs to. A mask with another digest was edited.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from neural_strands.capture.writer import HAIR_MASKS, PERSON_MASKS
from neural_strands.foundation.errors import InputError, excerpt
from neural_strands.foundation.files import atomic_file, write_json
from neural_strands.foundation.input_files import is_file_name
from neural_strands.foundation.json_files import read_json
from neural_strands.preparation.stage import digest_files

RECORD = "written_masks.json"
ADVICE = "keep copies of masks that you edited and remove this file; all masks are then written again"
REPLACED = "replaced_masks"
"""Folder, beside the stages, of edited masks that fit no picture of the capture any more."""


@dataclass(frozen=True)
class WrittenMask:
    """What the record says about one mask.

    Attributes:
        picture: digest of the picture.
        digests: digests of every version that was written.
    """

    picture: str
    digests: tuple[str, ...]


@dataclass(frozen=True)
class ChosenMasks:
    """Masks of one kind: those of a stage, or the user's where they were edited.

    Attributes:
        files: one for each picture, None where it has no mask.
        inputs: the user's, as an input of stages that read the masks; empty if there are none.
    """

    files: tuple[Path | None, ...]
    inputs: dict[str, str]

    def present(self) -> list[Path]:
        """The masks of the pictures that have one."""
        return [file for file in self.files if file is not None]


@dataclass(frozen=True)
class MaskEdits:
    """The masks of a capture, and which of them the user has edited.

    Attributes:
        capture: folder of the capture.
        stages: folder of the stages.
        record: what has been written, by KIND/NAME.
        pictures: digest of each present picture, by name.
        edited: edited masks that fit a present picture, as KIND/NAME.
        misfits: edited masks whose picture has changed or is gone.
    """

    capture: Path
    stages: Path
    record: Mapping[str, WrittenMask]
    pictures: Mapping[str, str]
    edited: tuple[str, ...]
    misfits: tuple[str, ...]

    @classmethod
    def find(cls, capture: Path, stages: Path, pictures: Sequence[Path]) -> "MaskEdits":
        """Compare the masks in a capture with the record.

        Raises:
            InputError: the record is damaged.
        """
        record = _read(stages / RECORD) if (stages / RECORD).is_file() else {}
        digests = {picture.name: digest_files([picture]) for picture in pictures}
        edited, misfits = [], []
        for name, written in record.items():
            file = capture / name
            if file.is_file() and digest_files([file]) not in written.digests:
                (edited if digests.get(file.name) == written.picture else misfits).append(name)
        return cls(capture, stages, record, digests, tuple(edited), tuple(misfits))

    def sentence(self) -> str:
        """What happens to the edited masks, for the user; empty if there are none."""
        told = ""
        if self.edited:
            told = f"{len(self.edited)} masks that you edited are kept ({_some(self.edited)}); delete one to undo that."
        if self.misfits:
            told += (
                f" {len(self.misfits)} that you edited no longer fit their pictures ({_some(self.misfits)}) and are "
                f"moved to {self.stages / REPLACED}."
            )
        return told.strip()

    def chosen(self, kind: str, masks: Sequence[Path | None]) -> ChosenMasks:
        """Replace masks of a stage, named like their pictures, by the user's where those were edited."""
        names = {file: f"{kind}/{file.name}" for file in masks if file is not None}
        edited = {file: self.capture / name for file, name in names.items() if name in self.edited}
        files = tuple(None if file is None else edited.get(file, file) for file in masks)
        return ChosenMasks(files, {"edited": digest_files(edited.values())} if edited else {})

    def write(self, masks: Mapping[str, Sequence[Path]]) -> None:
        """Copy masks into the capture; those that `chosen` returned from there stay as they are.

        Args:
            masks: files of each kind, named like their pictures.

        Raises:
            InputError: a file cannot be written.
        """
        for name in self.misfits:
            with atomic_file(self.stages / REPLACED / name) as path:
                shutil.copyfile(self.capture / name, path)
            (self.capture / name).unlink()
        copied = {
            f"{kind}/{file.name}": file
            for kind, files in masks.items()
            for file in files
            if file != self.capture / kind / file.name
        }
        record = {name: written for name, written in self.record.items() if name in self.edited}
        for name, file in copied.items():
            before = self.record[name].digests if name in self.record else ()
            digests = tuple(dict.fromkeys((*before, digest_files([file]))))
            record[name] = WrittenMask(self.pictures[file.name], digests)
        # Masks that the user has added where none was written are left alone.
        for name in self.record.keys() - record.keys():
            (self.capture / name).unlink(missing_ok=True)
        # Recorded before they are written: if this is interrupted, none of them counts as edited.
        if record != self.record:
            rows = {name: {"picture": row.picture, "digests": list(row.digests)} for name, row in record.items()}
            write_json(self.stages / RECORD, rows)
        for name, file in copied.items():
            with atomic_file(self.capture / name) as path:
                shutil.copyfile(file, path)


def _read(path: Path) -> dict[str, WrittenMask]:
    rows = read_json(path, "digests of the masks", ADVICE).members()
    for name in rows:
        # Masks of these names are moved and removed; no name may lead out of the capture.
        kind, _, mask = name.partition("/")
        if kind not in (HAIR_MASKS, PERSON_MASKS) or not is_file_name(mask):
            raise InputError(
                f"{path}: expected names of masks, such as {HAIR_MASKS}/0001.png, found {excerpt(name)}; {ADVICE}."
            )
    return {
        name: WrittenMask(
            row.member("picture").text(), tuple(digest.text() for digest in row.member("digests").elements())
        )
        for name, row in rows.items()
    }


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more
