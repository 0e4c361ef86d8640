"""Export of fitted and edited hair to other programs."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from neural_strands.editing.edit_list import HairMotion, hair_motion
from neural_strands.editing.guides import choose_guides
from neural_strands.foundation.configs import Between
from neural_strands.geometry.resample import resample
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.motion import Motion
from neural_strands.grooms.scenes.alembic import Blender
from neural_strands.grooms.scenes.scene import WITH_MOTION, Scene, write_scene
from neural_strands.model.strand_colours import cameras_around, strand_colours
from neural_strands.runs.edited import EditedHair


@dataclass(frozen=True)
class ExportConfig:
    """Settings of an export."""

    points: Annotated[int, Between(2, 10_000)] | None = None
    """Points per strand; None keeps those of the hair."""
    guides: Annotated[int, Between(0, 100_000)] = 500
    """Number of guides, if the format stores them; 0 for none."""


def export_hair(edited: EditedHair, path: Path, config: ExportConfig, blender: Blender) -> Strands:
    """Write hair with its colours and its motion to a file; returns the strands at rest.

    Raises:
        InputError: the suffix is unknown, Blender is needed and missing, or the file cannot be written.
    """
    strands = coloured(edited)
    if config.points is not None and config.points != strands.points_per_strand:
        strands = resample(strands, config.points)
    motion = None
    if path.suffix.lower() in WITH_MOTION:
        motion = groom_motion(hair_motion(replace(edited.hair, strands=strands), edited.edits))
    strands = strands.to("cpu")
    guides = None
    if config.guides:
        guides = Groom.from_strands(strands.select(choose_guides(strands.points[:, 0], config.guides)))
    write_scene(path, Scene(Groom.from_strands(strands), guides, motion), blender)
    return strands


def groom_motion(blown: HairMotion | None) -> Motion | None:
    """Convert the motion of hair in the wind to that of its groom."""
    if blown is None:
        return None
    wind = blown.wind
    return Motion(wind.fps, wind.frames, lambda frame: blown.at(frame / wind.fps).reshape(-1, 3))


def coloured(edited: EditedHair) -> Strands:
    """Give each strand a colour rendered by its model; without a model, the strands are returned unchanged."""
    strands = edited.hair.strands
    if edited.hair.model is None:
        return strands
    renderer = edited.renderer("export")
    return replace(strands, color=strand_colours(renderer, cameras_around(renderer)))
