"""Lists of edits: applying them to hair, and storing them as JSON.

Edits of the scalp textures are applied first, whatever their position in the list, because strands are decoded from
them; edits of the strands follow. Each group is applied in the order of the list. So a cut followed by a change of
density cuts the denser hair. Wind moves the result; of several winds, the last one counts.
"""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from neural_strands.editing.density import change_density
from neural_strands.editing.hair import Hair, ScalpShape
from neural_strands.editing.haircut import arc_lengths, cut_hair
from neural_strands.editing.mix import blend, transfer
from neural_strands.editing.outside import CLEARANCE, follow_outside
from neural_strands.editing.restyle import restyle
from neural_strands.editing.sample import sample_style
from neural_strands.editing.settings import KINDS, Blend, Density, Edit, Haircut, Restyle, Sample, Transfer, Wind
from neural_strands.editing.simulated_wind import SimulatedHair
from neural_strands.editing.wind import BlownHair
from neural_strands.foundation.configs import config_from_json
from neural_strands.foundation.files import write_json
from neural_strands.foundation.json_files import JsonValue, check_format, read_json
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.strands import Strands, segments
from neural_strands.model.hair_model import HairModel

HairMotion = BlownHair | SimulatedHair
"""Hair in the wind at any moment: `wind`, and `at(seconds)`."""
FORMAT = 1
"""Version of the list's layout."""
OF_TEXTURES: dict[type, Callable[[Any, ScalpShape, HairModel], ScalpShape]] = {
    Density: change_density,
    Restyle: restyle,
    Blend: blend,
    Transfer: transfer,
    Sample: sample_style,
}
"""Functions that apply edits of the scalp textures and roots."""
OF_STRANDS: dict[type, Callable[[Any, Strands], Strands]] = {Haircut: cut_hair}
"""Functions that apply edits of strands."""
RISE = 0.3
"""Slope at which strands of a new shape leave the skin: height over length."""
NAME = "edit"
"""Key in JSON of an edit's name."""


def apply_edits(hair: Hair, edits: Sequence[Edit]) -> Hair:
    """Apply edits to hair as it was fitted.

    Raises:
        InputError: an edit needs a model but the hair is only a groom, or its settings do not suit the hair.
    """
    of_textures = [edit for edit in edits if type(edit) in OF_TEXTURES]
    strands = hair.strands
    if of_textures:
        model = hair.modelled(edit_name(of_textures[0]))
        shape = ScalpShape.of(model)
        for edit in of_textures:
            shape = OF_TEXTURES[type(edit)](edit, shape, model)
        strands = shape.decode(model)
        if any(type(edit) is not Density for edit in of_textures):
            strands = kept_outside(strands, hair.body_grid)
    for edit in edits:
        if type(edit) in OF_STRANDS:
            strands = OF_STRANDS[type(edit)](edit, strands)
    return dataclasses.replace(hair, strands=strands)


def fitted_per_strand(fitted: Strands, edits: Sequence[Edit]) -> float:
    """Number of fitted strands that each edited one stands for.

    A fit chooses the number of strands, and its appearance and light belong to it. Other numbers show the same hair
    more finely or more coarsely, so they must not change how much light the hair lets through.
    """
    counts = [edit.strands for edit in edits if isinstance(edit, Density)]
    return len(fitted) / counts[-1] if counts else 1.0


def hair_motion(hair: Hair, edits: Sequence[Edit]) -> HairMotion | None:
    """The motion of the edited hair; None if no edit is a wind."""
    wind = next((edit for edit in reversed(edits) if isinstance(edit, Wind)), None)
    if wind is None:
        return None
    return (SimulatedHair if wind.simulate else BlownHair)(wind, hair.strands, hair.body_grid)


def kept_outside(strands: Strands, body: SignedDistanceGrid | None) -> Strands:
    """Bend strands of a new shape around the head where they would enter it."""
    rising = (RISE * arc_lengths(strands.points)).clamp(max=CLEARANCE)
    points = follow_outside(strands.points[:, 0], segments(strands.points), body, rising)
    return dataclasses.replace(strands, points=points)


def edit_name(edit: Edit) -> str:
    """The name of an edit in JSON and on the command line."""
    return next(name for name, kind in KINDS.items() if type(edit) is kind)


def edits_as_json(edits: Sequence[Edit]) -> list[dict[str, Any]]:
    """The list as JSON values; settings that are not set are omitted."""
    documents = []
    for edit in edits:
        settings = {name: value for name, value in dataclasses.asdict(edit).items() if value not in (None, ())}
        documents.append({NAME: edit_name(edit), **settings})
    return documents


def edits_from_json(written: JsonValue) -> list[Edit]:
    """Parse a list that `edits_as_json` made.

    Raises:
        InputError: an edit does not exist, or a setting has the wrong type or is out of bounds.
    """
    edits: list[Edit] = []
    for element in written.elements():
        kind = KINDS[element.member(NAME).choice(list(KINDS))]
        settings = {name: value for name, value in element.value.items() if name != NAME}
        edits.append(config_from_json(kind, dataclasses.replace(element, value=settings)))
    return edits


def read_edits(path: Path) -> list[Edit]:
    """Read a list of edits: `edits.json`, or the `edit.json` of an edited result.

    Raises:
        InputError: the file is missing or has other contents.
    """
    written = read_json(path, "a list of edits")
    check_format(written, FORMAT)
    return edits_from_json(written.member("edits"))


def write_edits(path: Path, edits: Sequence[Edit]) -> None:
    """Write a list of edits.

    Raises:
        InputError: the file cannot be written.
    """
    write_json(path, {"format": FORMAT, "edits": edits_as_json(edits)})
