"""The heading of a strand, in coordinates whose origin is a strand that stands up from the scalp.

Hair grows in every direction except into the head, so the ends of strands fill a sphere around the root, apart from its
south pole. In Cartesian coordinates the mean of all strands ends at the centre of that sphere: it is crumpled. Here the
end is given by its stereographic projection from the south pole and by the logit of its distance in strand lengths: a
flat space whose origin is the north pole, the normal of the scalp.
"""

import torch
from jaxtyping import Float
from torch import Tensor

FARTHEST = 1.05
"""Largest distance of the smooth part's end from the root, in strand lengths."""
SOUTHERNMOST = -0.999
"""Lowest cosine of a heading with the normal; lower ones are clamped to it."""


def smooth_from_heading(
    coded: Float[Tensor, "strand 3 smooth"], reach: Float[Tensor, " smooth"]
) -> Float[Tensor, "strand 3 smooth"]:
    """Weights of the smooth functions from coordinates whose first column is the heading.

    Args:
        coded: heading (two stereographic coordinates and the logit of the distance), then the weights of the other
            smooth functions on each axis.
        reach: integral of each smooth function over t.
    """
    east, north, distance = coded[..., 0].unbind(dim=1)
    squared = east * east + north * north
    unit = torch.stack([2 * east, 2 * north, 1 - squared], dim=1) / (1 + squared)[:, None]
    end = FARTHEST * distance.sigmoid()[:, None] * unit
    first = (end - coded[..., 1:] @ reach[1:]) / reach[0]
    return torch.cat([first[..., None], coded[..., 1:]], dim=2)


def heading_from_smooth(
    smooth: Float[Tensor, "strand 3 smooth"], reach: Float[Tensor, " smooth"]
) -> Float[Tensor, "strand 3 smooth"]:
    """Inverse of `smooth_from_heading`; headings into the scalp and ends out of reach are clamped."""
    end = smooth @ reach
    distance = end.norm(dim=1)
    unit = end / distance.clamp(min=1e-9)[:, None]
    bounded = unit[:, 2].clamp(min=SOUTHERNMOST)
    size = unit[:, :2].norm(dim=1, keepdim=True)
    anywhere = torch.tensor([1.0, 0.0], dtype=unit.dtype, device=unit.device)
    horizontal = torch.where(size > 1e-9, unit[:, :2] / size.clamp(min=1e-9), anywhere)
    # tan(angle / 2), with the angle measured from the normal.
    radius = ((1 - bounded) / (1 + bounded)).clamp(min=0).sqrt()
    logit = torch.logit((distance / FARTHEST).clamp(1e-4, 1 - 1e-4))
    first = torch.cat([horizontal * radius[:, None], logit[:, None]], dim=1)
    return torch.cat([first[..., None], smooth[..., 1:]], dim=2)
