"""Edited hair on disk: a folder with the source of the hair, the list of edits, and the resulting strands.

    OUT/edit.json     the source (a run, a model or a groom) and the edits, applied in order; edit it and apply it again
    OUT/groom.npz     the edited strands

A run, a model's folder, a groom file and an edited folder can all be opened as hair.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from neural_strands.editing.edit_list import (
    FORMAT,
    HairMotion,
    apply_edits,
    edits_as_json,
    edits_from_json,
    fitted_per_strand,
    hair_motion,
)
from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import Edit
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_folder, is_taken, write_json
from neural_strands.foundation.json_files import check_format, read_json
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom, write_groom
from neural_strands.model.files import find_hair_model, load_hair_model
from neural_strands.model.renderer import HairRenderer
from neural_strands.runs.run_folder import LONGEST_PATH, RunFolder, place_now

EDIT_NAME = "edit.json"
GROOM_NAME = "groom.npz"
POINTS = 100
"""Points per strand of a groom whose strands have different numbers of points."""


@dataclass(frozen=True)
class EditedHair:
    """Hair with its edits.

    Attributes:
        source: the run, model or groom that the hair comes from.
        fitted: the hair without edits.
        edits: the edits, in the order of their application.
        hair: the hair after the edits.
    """

    source: Path
    fitted: Hair
    edits: tuple[Edit, ...]
    hair: Hair

    def edited(self, edits: Sequence[Edit]) -> "EditedHair":
        """Apply further edits after the present ones.

        Raises:
            InputError: the edits do not suit the hair.
        """
        together = (*self.edits, *edits)
        return replace(self, edits=together, hair=apply_edits(self.fitted, together))

    def renderer(self, purpose: str) -> HairRenderer:
        """Return a renderer of the edited hair, relit for the light that reaches it now.

        Args:
            purpose: what it is needed for, for the error message.

        Raises:
            InputError: the hair is only a groom.
        """
        fitted = self.fitted.strands
        return HairRenderer.of(self.fitted.modelled(purpose), fitted).showing(
            self.hair.strands, fitted_per_strand(fitted, self.edits)
        )

    def motion(self) -> HairMotion | None:
        """The motion of the hair; None without wind."""
        return hair_motion(self.hair, self.edits)


def open_hair(path: Path, device: torch.device | str = "cpu") -> EditedHair:
    """Open a run, a model's folder, an edited folder, or a groom file (metres, y up).

    Raises:
        InputError: it is none of these, or is damaged.
    """
    if not path.exists():
        raise InputError(
            f"{path}: expected a run, a model, edited hair or a groom file, found nothing; check the path."
        )
    if (path / EDIT_NAME).is_file():
        return _open_edited(path, device)
    if path.is_dir():
        model = load_hair_model(_model_of(path), device).eval()
        hair = marked(Hair.of(model), RunFolder(path).groom_arrays)
    else:
        hair = Hair(_strands(read_groom(path)).to(device))
    return EditedHair(path, hair, (), hair)


def save_edited(folder: Path, edited: EditedHair) -> None:
    """Write edited hair; an existing folder of edited hair is replaced.

    Raises:
        InputError: the folder cannot be written, or has other contents.
    """
    if not (folder / EDIT_NAME).is_file() and is_taken(folder):
        raise InputError(f"{folder}: expected a new folder or one of edited hair, found something else; name another.")
    source = edited.source.absolute()
    document = {"format": FORMAT, "source": str(source), "folder": str(folder.absolute())}
    with atomic_folder(folder) as temporary:
        write_json(temporary / EDIT_NAME, {**document, "edits": edits_as_json(edited.edits)})
        write_groom(temporary / GROOM_NAME, Groom.from_strands(edited.hair.strands.to("cpu")))


def _open_edited(folder: Path, device: torch.device | str) -> EditedHair:
    written = read_json(folder / EDIT_NAME, "a description of edited hair")
    check_format(written, FORMAT)
    edits = edits_from_json(written.member("edits"))
    source, place = (written.member(name).text(LONGEST_PATH) for name in ("source", "folder"))
    found = place_now(folder, place, source)
    if not found.exists():
        raise InputError(
            f"{folder}: expected the hair that was edited at {found}, found nothing there; restore it, or move both "
            "together."
        )
    fitted = open_hair(found, device).fitted
    strands = _strands(read_groom(folder / GROOM_NAME)).to(device)
    return EditedHair(found, fitted, tuple(edits), replace(fitted, strands=strands))


def _model_of(folder: Path) -> Path:
    """The folder of the model: the folder itself, or a part of a run.

    Raises:
        InputError: it is a run whose fit has not ended.
    """
    model, run = find_hair_model(folder), RunFolder(folder)
    if run.description.is_file() and not model.exists():
        raise InputError(
            f"{folder}: expected a fit that has ended, found one that has not written its model yet; wait for it, "
            "continue it with `fit --resume`, or look at it with `view`."
        )
    return model


def _strands(groom: Groom) -> Strands:
    """The strands unchanged, or resampled if their numbers of points differ."""
    return groom.strands(POINTS if groom.uniform_size is None else None)


def marked(hair: Hair, groom: Path) -> Hair:
    """Add colours and unseen shares of the strands, which a run's groom stores, to its hair.

    Args:
        hair: the hair as decoded by the model.
        groom: file of the run's groom; if it is missing or has another number of strands, the hair is returned
            unchanged.
    """
    if not groom.is_file():
        return hair
    said, strands = read_groom(groom), hair.strands
    if len(said) != len(strands):
        return hair
    color, unseen = (None if part is None else part.to(strands.points) for part in (said.color, said.unseen))
    return replace(hair, strands=replace(strands, color=color, unseen=unseen))
