"""Painted regions of the scalp chart: which strands an edit affects, and how strongly."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.settings import Dabs
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.geometry.strands import Strands

HARD = 0.6
"""Share of a dab's radius within which it has full weight; beyond, it fades to zero at the radius."""
DABS_AT_ONCE = 64
"""Number of dabs compared with all strands together, to bound memory."""


def region_weight(uv: Float[Tensor, "root 2"], dabs: Dabs) -> Float[Tensor, " root"]:
    """Weight of an edit at each root: that of the strongest dab, or 1 everywhere without dabs."""
    if not dabs:
        return uv.new_ones(len(uv))
    weight = uv.new_zeros(len(uv))
    painted = uv.new_tensor(dabs).reshape(-1, 3)
    for part in painted.split(DABS_AT_ONCE):
        share = torch.cdist(uv, part[:, :2]) / part[:, 2].clamp(min=1e-9)
        weight = torch.maximum(weight, smoothstep((1 - share) / (1 - HARD)).amax(dim=1))
    return weight


def strand_weight(strands: Strands, dabs: Dabs, edit: str) -> Float[Tensor, " strand"]:
    """Weight of an edit on each strand.

    Args:
        strands: with `root_uv` if there are dabs.
        dabs: the painted region; empty for the whole scalp.
        edit: name of the edit, for error messages.

    Raises:
        InputError: a region is painted, but the strands have no `root_uv` or none is in the region.
    """
    if not dabs:
        return strands.points.new_ones(len(strands))
    if strands.root_uv is None:
        raise InputError(
            f"{edit}: expected strands with root_uv for a painted region, found none; edit the whole scalp, or a "
            "groom that holds root_uv (.npz or .usd)."
        )
    return checked_weight(region_weight(strands.root_uv, dabs), edit)


def checked_weight(weight: Float[Tensor, " root"], edit: str) -> Float[Tensor, " root"]:
    """Refuse a region that selects nothing.

    Raises:
        InputError: no weight is above zero.
    """
    if not (weight > 0).any():
        raise InputError(f"{edit}: expected a painted region with strands, found none in it; paint where roots are.")
    return weight
