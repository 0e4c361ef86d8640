"""The last step of a preparation: writes pictures, masks, head and cameras in the layout of a capture."""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Int64
from torch import Tensor

from neural_strands.capture.writer import HAIR_MASKS, IMAGES, PERSON_MASKS, CaptureWriter
from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.mask_edits import MaskEdits
from neural_strands.scalp.head import Head

HAIRLINE = 0.5
"""Least share of views that must see hair in front of a point for it to remain scalp."""


@dataclass(frozen=True)
class CaptureFiles:
    """The contents of a capture.

    Attributes:
        cameras: cameras of the views, world metres.
        pictures: undistorted pictures, one per camera.
        hair: masks of the hair, named like the pictures.
        outlines: masks of the person, named like the pictures; views may lack one.
        edits: the user's edits of earlier masks.
        head: the head, world metres.
        scalp: faces of the head that hair grows from.
    """

    cameras: Sequence[Camera]
    pictures: Sequence[Path]
    hair: Sequence[Path]
    outlines: Sequence[Path]
    edits: MaskEdits
    head: Head
    scalp: Int64[Tensor, " scalp"]

    def write(self, out: Path) -> None:
        """Write the capture; pictures are hard links to the stages' files, masks are copies, which may be edited.

        The cameras come last and mark the capture as complete.

        Raises:
            InputError: the disk is full, or the folder cannot be written to.
        """
        (out / "transforms.json").unlink(missing_ok=True)
        shutil.rmtree(out / IMAGES, ignore_errors=True)
        for file in self.pictures:
            with atomic_file(out / IMAGES / file.name) as path:
                _share(file, path)
        self.edits.write({HAIR_MASKS: self.hair, PERSON_MASKS: self.outlines})
        writer = CaptureWriter(out)
        writer.write_head(self.head.mesh, self.scalp)
        writer.finish(self.cameras)


def person_scalp(head: Head, vote: np.ndarray) -> Int64[Tensor, " scalp"]:
    """Drop faces from the scalp that most photographs show to be bare skin.

    Args:
        head: a placed template.
        vote: (vertex,) share of the views that see hair in front of each vertex; NaN if no view shows it.
    """
    bare = torch.from_numpy(np.nan_to_num(vote, nan=1.0) < HAIRLINE)
    faces = head.mesh.faces[head.scalp_faces]
    kept = head.scalp_faces[~bare[faces].all(dim=1)]
    return kept if len(kept) else head.scalp_faces


def _share(source: Path, target: Path) -> None:
    """Hard-link a file, or copy it if the file system cannot."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
