"""A brush that paints regions of the scalp chart: each touch adds a dab under the pointer."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.settings import Dab
from neural_strands.foundation.errors import InputError

REACH = 0.01
"""Largest distance of a root under the pointer from the ray, metres."""
FRONT = 0.03
"""Roots farther than this behind the first along the ray, metres, lie on the other side of the head."""
FEWEST = 6
"""Fewest roots from which the scale of the chart is estimated."""


def dab_under(
    origin: Float[Tensor, "3"],
    direction: Float[Tensor, "3"],
    roots: Float[Tensor, "root 3"],
    uv: Float[Tensor, "root 2"],
    radius: float,
) -> Dab:
    """Compute the dab that a brush paints where a ray meets the scalp, ignoring hair in front of it.

    Args:
        origin: start of the ray, world metres.
        direction: direction of the ray, of any length.
        roots: positions of the roots, world metres.
        uv: positions of the roots on the chart.
        radius: radius of the brush, metres.

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
    """Chart units per metre around a root: the median over nearby roots, except those on other islands of the chart."""
    near = (roots - roots[root]).norm(dim=1)
    nearest = near.topk(min(FEWEST + 1, len(roots)), largest=False).indices
    nearest = nearest[near[nearest] > 0]
    if len(nearest) == 0:
        return 1.0
    return float(((uv[nearest] - uv[root]).norm(dim=1) / near[nearest]).median())
