"""`neural-strands edit`: cut hair, change its density, or apply a list of edits."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.editing.settings import Blend, Density, Haircut, Restyle, Sample, Transfer, Wind
from neural_strands.foundation.configs import check_config
from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    from neural_strands.editing.settings import Edit as HairEdit

Kind = (
    Annotated[Haircut, tyro.conf.subcommand("haircut")]
    | Annotated[Density, tyro.conf.subcommand("density")]
    | Annotated[Restyle, tyro.conf.subcommand("restyle")]
    | Annotated[Blend, tyro.conf.subcommand("blend")]
    | Annotated[Transfer, tyro.conf.subcommand("transfer")]
    | Annotated[Sample, tyro.conf.subcommand("sample")]
    | Annotated[Wind, tyro.conf.subcommand("wind")]
)


@dataclass(frozen=True)
class Edit:
    """Edit fitted hair: `edit RUN OUT haircut --length 0.12`, or `edit RUN OUT --edits edits.json`.

    OUT is a folder with edit.json (where the hair came from, and the list of edits) and groom.npz (the edited strands).
    `render`, `export` and `edit` open it like a run. An edited folder as input keeps its edits, and the new ones are
    added. A groom file can only have edits that need no model.
    """

    source: Annotated[Path, tyro.conf.Positional]
    """Run, folder of a model, edited folder, or groom file (metres, y up)."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder for the edited hair."""
    edit: Annotated[Kind | None, tyro.conf.arg(name="")] = None
    """The edit."""
    edits: Path | None = None
    """JSON file with a list of edits, instead of a single edit: {"format": 1, "edits": [{"edit": "haircut", "length":
    0.12}, ...]}."""
    device: DeviceName = "auto"
    """Where to compute."""

    def run(self) -> None:
        """Open, edit, write."""
        from neural_strands.editing.edit_list import edit_name
        from neural_strands.runs.edited import open_hair, save_edited

        edits = self._edits()
        hair = open_hair(self.source, pick_device(self.device))
        edited = hair.edited(edits)
        save_edited(self.out, edited)
        before, after = len(hair.hair.strands), len(edited.hair.strands)
        done = ", ".join(edit_name(edit) for edit in edits) or "no edits"
        sys.stderr.write(f"{self.out}: {after:,} strands after {done}; {before:,} before.\n")

    def _edits(self) -> "list[HairEdit]":
        from neural_strands.editing.edit_list import edit_name, read_edits

        if self.edit is not None and self.edits is not None:
            raise InputError("edit: expected an edit such as haircut or a list in --edits, found both; give one.")
        if self.edits is not None:
            return read_edits(self.edits)
        if self.edit is None:
            raise InputError("edit: expected an edit such as haircut or a list in --edits, found neither; give one.")
        check_config(self.edit, edit_name(self.edit))
        if self.edit == Restyle():
            raise InputError("restyle: expected a change, found none; give --length, --curl, --wave or --volume.")
        return [self.edit]
