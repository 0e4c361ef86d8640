"""Directions in space: the point at which several rays meet, and directions spread evenly over the sphere."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

AHEAD = 1e-9
"""Weight of the points one unit ahead on the rays, which decide where parallel rays leave the answer open."""


def nearest_to_rays(origins: Float[Tensor, "ray 3"], directions: Float[Tensor, "ray 3"]) -> Float[Tensor, "3"]:
    """Find the point that is nearest to several lines: the sum of its squared distances to them is smallest.

    Parallel lines leave the place along them open; the result is then the mean of the points one unit ahead of the
    origins. Computed in double precision.

    Args:
        origins: a point on each line; at least one line.
        directions: directions of the lines.
    """
    # Unit to the last bit, or parallel lines of single precision would seem to meet.
    starts, along = origins.double(), torch.nn.functional.normalize(directions.double(), dim=1)
    across = torch.eye(3, dtype=along.dtype, device=along.device) - along[:, :, None] * along[:, None, :]
    ahead = AHEAD * torch.eye(3, dtype=along.dtype, device=along.device)
    system = across.sum(dim=0) + len(along) * ahead
    right = (across @ starts[:, :, None]).sum(dim=0) + AHEAD * (starts + along).sum(dim=0)[:, None]
    return torch.linalg.solve(system, right)[:, 0].to(origins)


def spread_directions(count: int) -> Float[Tensor, "count 3"]:
    """Unit directions spread evenly over the sphere, from +y down to -y: a Fibonacci lattice."""
    place = torch.arange(count) + 0.5
    height = 1 - 2 * place / max(count, 1)
    turn = place * math.pi * (1 + 5**0.5)
    across = (1 - height.square()).sqrt()
    return torch.stack([across * turn.cos(), height, across * turn.sin()], dim=1)
