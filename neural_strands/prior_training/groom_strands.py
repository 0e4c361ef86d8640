"""Reads strands of a groom file in the local frames of their roots."""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.ground_truth import read_ground_truth
from neural_strands.capture.head import head_path
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import array_names
from neural_strands.geometry.frames import to_local
from neural_strands.geometry.resample import resample_strands
from neural_strands.geometry.strands import lengths
from neural_strands.grooms.io import read_groom
from neural_strands.scalp.fit_similarity import fit_similarity
from neural_strands.scalp.head_file import read_metric_head
from neural_strands.scalp.load import chart_head
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import attach_roots

SHORTEST = 0.003
"""Shorter strands (metres) are dropped: they are stubs that no tool shows."""


def local_strands(groom: Path, head: Path | None, points: int = 100) -> Float[Tensor, "strand {points} 3"]:
    """Read a groom and express each strand in its root's frame on the head, metres, the root at 0.

    Strands that are not finite, or shorter than `SHORTEST`, are skipped.

    Args:
        groom: any file that `read_groom` reads, a capture's folder, or its ground_truth.npz.
        head: mesh in the groom's frame, metres; a scalp_faces.json beside it is used. Without a head, the capture's own
            head is used, or the mannequin, fitted to the roots by a similarity that also gives unit and axes.
        points: points per strand in the result.

    Raises:
        InputError: the groom or the head cannot be read, or no strand is usable.
    """
    truth = groom / "ground_truth.npz" if groom.is_dir() else groom
    captured = "strands" in array_names(truth)
    if captured:
        strands = resample_strands(read_ground_truth(truth).points, points)
        head = head_path(truth.parent, head)
    else:
        strands = read_groom(truth).strands(points).points
    if len(strands) == 0:
        raise InputError(f"{groom}: expected strands, found none; give another file.")
    if head is None:
        template = mannequin()
        if len(strands) < 10:
            raise InputError(
                f"{groom}: expected at least 10 roots to fit a head to, found {len(strands)}; give --head."
            )
        back = fit_similarity(template, strands[:, 0]).inverse()
        strands = back.apply(strands)
    else:
        template = chart_head(read_metric_head(head))
    local = to_local(strands, strands[:, 0], attach_roots(template, strands[:, 0]).frame)
    kept = torch.isfinite(local).flatten(1).all(dim=1) & (lengths(local) >= SHORTEST)
    if not kept.any():
        raise InputError(f"{groom}: expected strands of at least {1000 * SHORTEST:g} mm, found none; check the unit.")
    return local[kept]
