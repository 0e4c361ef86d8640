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
        outlines: masks of the person, named like the pictures; None for views without one.
        head: the head, world metres.
        scalp: faces of the head that hair grows from.
    """

    cameras: Sequence[Camera]
    pictures: Sequence[Path]
    hair: Sequence[Path]
    outlines: Sequence[Path | None]
    head: Head
    scalp: Int64[Tensor, " scalp"]

    def write(self, out: Path) -> None:
        """Write the capture, hard-linking the stages' files; the cameras come last and mark it as complete.

        Raises:
            InputError: the disk is full, or the folder cannot be written to.
        """
        (out / "transforms.json").unlink(missing_ok=True)
        for kind, files in ((IMAGES, self.pictures), (HAIR_MASKS, self.hair), (PERSON_MASKS, self.outlines)):
            shutil.rmtree(out / kind, ignore_errors=True)
            there = [file for file in files if file is not None]
            for file in there:
                with atomic_file(out / kind / file.name) as path:
                    _share(file, path)
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
