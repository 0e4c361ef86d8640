"""The last step: pictures, masks, head and cameras where a capture has them."""

import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Int64
from torch import Tensor

from neural_strands.capture.writer import CaptureWriter
from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.cameras.calibration import IMAGES, write_transforms
from neural_strands.scalp.head import Head

HAIRLINE = 0.5
"""Share of views that must see hair before a point for it to stay scalp."""


@dataclass(frozen=True)
class CaptureFiles:
    """What goes into a capture.

    Attributes:
        cameras: in world metres.
        pictures: undistorted, one a camera.
        hair: masks of the hair, named as the pictures.
        outlines: masks of the person, named as the pictures; None where there is none.
        head: in world metres.
        scalp: faces of the head that hair grows from.
    """

    cameras: Sequence[Camera]
    pictures: Sequence[Path]
    hair: Sequence[Path]
    outlines: Sequence[Path | None]
    head: Head
    scalp: Int64[Tensor, " scalp"]

    def write(self, out: Path) -> None:
        """Write the capture; its cameras last, for they make it one. Files are shared with the stages, not copied.

        Raises:
            InputError: the disk is full, or the folder cannot be written to.
        """
        (out / "transforms.json").unlink(missing_ok=True)
        for kind, files in ((IMAGES, self.pictures), ("masks", self.hair), ("person_masks", self.outlines)):
            shutil.rmtree(out / kind, ignore_errors=True)
            there = [file for file in files if file is not None]
            for file in there:
                with atomic_file(out / kind / file.name) as path:
                    _share(file, path)
        CaptureWriter(out).write_head(self.head.mesh, self.scalp)
        with atomic_file(out / "transforms.json") as path:
            write_transforms(path, self.cameras)


def person_scalp(head: Head, vote: np.ndarray) -> Int64[Tensor, " scalp"]:
    """The scalp's faces that are not seen bare: where most photographs see skin, nothing is rooted.

    Args:
        head: a placed template.
        vote: (vertex,) share of the views that see hair before each vertex; NaN where none shows it.
    """
    bare = torch.from_numpy(np.nan_to_num(vote, nan=1.0) < HAIRLINE)
    faces = head.mesh.faces[head.scalp_faces]
    kept = head.scalp_faces[~bare[faces].all(dim=1)]
    return kept if len(kept) else head.scalp_faces


def _share(source: Path, target: Path) -> None:
    """The same file under another name, or a copy where the disk cannot do that."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
