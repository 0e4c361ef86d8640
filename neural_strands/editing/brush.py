"""A brush that paints a region of the scalp chart: what lies under a pointer becomes a dab."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.settings import Dab
from neural_strands.foundation.errors import InputError

REACH = 0.01
"""How far from a ray a root may lie and still be under the pointer, metres."""
FRONT = 0.03
"""How much farther along the ray than the first root; those beyond lie on the other side of the head, metres."""
FEWEST = 6
"""Roots from which the size of the chart is taken."""


def dab_under(
    origin: Float[Tensor, "3"],
    direction: Float[Tensor, "3"],
    roots: Float[Tensor, "root 3"],
    uv: Float[Tensor, "root 2"],
    radius: float,
) -> Dab:
    """The dab that a brush leaves where a ray meets the scalp, whatever hair hangs in front of it.

    Args:
        origin: where the ray begins, world metres.
        direction: where it leads to, of any length.
        roots: world metres.
        uv: their places on the chart.
        radius: of the brush, metres.

    Raises:
        InputError: no root lies near the ray.
    """
    along = torch.nn.functional.normalize(direction, dim=0)
    depth = (roots - origin) @ along
    beside = (roots - origin - depth[:, None] * along).norm(dim=1)
    under = (beside < REACH) & (depth > 0)
    if not under.any():
        raise InputError("Painting: expected a click on the scalp, found no roots of hair there; click on the head.")
    under &= depth < depth[under].min() + FRONT
    root = int(torch.where(under, beside, torch.inf).argmin())
    u, v = uv[root].tolist()
    return u, v, radius * chart_scale(roots, uv, root)


def chart_scale(roots: Float[Tensor, "root 3"], uv: Float[Tensor, "root 2"], root: int) -> float:
    """Chart units per metre around a root: the median over the roots near it, those of other islands left out."""
    near = (roots - roots[root]).norm(dim=1)
    nearest = near.topk(min(FEWEST + 1, len(roots)), largest=False).indices
    nearest = nearest[near[nearest] > 0]
    if len(nearest) == 0:
        return 1.0
    return float(((uv[nearest] - uv[root]).norm(dim=1) / near[nearest]).median())
