"""Strands of a groom file in the local frames of their roots."""

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.frames import to_local
from neural_strands.geometry.strands import lengths
from neural_strands.grooms.io import read_groom
from neural_strands.scalp.fit_similarity import fit_similarity
from neural_strands.scalp.load import load_head
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import attach_roots

SHORTEST = 0.003
"""Strands shorter than this (metres) are dropped: stubs that no tool shows."""


def local_strands(groom: Path, head: Path | None, points: int = 100) -> Float[Tensor, "strand {points} 3"]:
    """Read a groom and express each strand in its root's frame on the head, metres, the root at 0.

    Args:
        groom: any file that `read_groom` takes.
        head: mesh in the groom's frame, metres; a scalp_faces.json beside it is used. Without one the mannequin is
            fitted to the roots by a similarity, which also gives the groom's unit and axes.
        points: wanted a strand.

    Raises:
        InputError: the groom or the head cannot be read, or no strand is usable.
    """
    strands = read_groom(groom).strands(points).points
    if len(strands) == 0:
        raise InputError(f"{groom}: expected strands, found none; give another file.")
    if head is None:
        template = mannequin()
        if len(strands) < 10:
            raise InputError(f"{groom}: expected at least 10 roots to fit a head to, got {len(strands)}; give --head.")
        back = fit_similarity(template, strands[:, 0]).inverse()
        strands = back.apply(strands)
    else:
        beside = head.parent / "scalp_faces.json"
        template = load_head(head, beside if beside.is_file() else None)
    local = to_local(strands, strands[:, 0], attach_roots(template, strands[:, 0]).frame)
    kept = torch.isfinite(local).flatten(1).all(dim=1) & (lengths(local) >= SHORTEST)
    if not kept.any():
        raise InputError(f"{groom}: expected strands of at least {1000 * SHORTEST:g} mm, found none; check the unit.")
    return local[kept]
