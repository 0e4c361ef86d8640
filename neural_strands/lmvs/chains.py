"""Turn an oriented point cloud into chains of points: mean shift, then growing (Nam et al. 2019, section 5)."""

import math
from dataclasses import dataclass
from typing import Annotated

import torch
import warp as wp
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.foundation.configs import Between
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.consistency import LineCloud
from neural_strands.lmvs.fusion import cell_keys
from neural_strands.lmvs.kernels import chains as chain_kernels


@dataclass(frozen=True)
class ChainConfig:
    """Settings of mean shift and growing; lengths in pixel footprints, angles in degrees."""

    radius: Annotated[float, Between(0.01, 1000)] = 2.0
    """Radius of the mean shift."""
    rounds: Annotated[int, Between(0, 100)] = 2
    """Mean shifts of each point before chains grow."""
    angle: Annotated[float, Between(0, 90)] = 25.0
    """Neighbours with a larger angle belong to another strand."""
    turn: Annotated[float, Between(0, 90)] = 20.0
    """Largest turn of a chain from one point to the next."""
    step: Annotated[float, Between(0.01, 1000)] = 1.0
    """Distance between the points of a chain."""
    spacing: Annotated[float, Between(0.01, 1000)] = 0.6
    """Points nearer than this to a chain belong to it and start no other."""
    support: Annotated[float, Between(0, 1000)] = 0.4
    """Smallest sum of weights around a point of a chain."""
    steps: Annotated[int, Between(1, 10_000)] = 24
    """Largest number of points by which a chain grows in each direction."""
    shortest: Annotated[int, Between(2, 10_000)] = 3
    """Chains of fewer points are dropped."""
    apart: Annotated[float, Between(0.01, 1000)] = 6.0
    """Distance between seeds grown together."""
    batch: Annotated[int, Between(1, 10_000_000)] = 8192
    """Number of seeds grown together."""


class Cloud:
    """An oriented cloud in a hash grid."""

    def __init__(self, points: Tensor, directions: Tensor, weight: Tensor, radius: float) -> None:
        """Sort the points into cells of `radius` metres."""
        kernels.start_warp()
        self.device = points.device
        self.place, self.line = kernels.array(points, wp.vec3), kernels.array(directions, wp.vec3)
        self.weight = kernels.array(weight)
        self.grid = wp.HashGrid(128, 128, 128, device=str(self.place.device))
        with kernels.on_torch_stream(self.device):
            self.grid.build(self.place, radius)
        self.inputs = [self.grid.id, self.place, self.line, self.weight]


def mean_shift(cloud: LineCloud, radius: float, degrees: float, rounds: int) -> tuple[Tensor, Tensor, Tensor]:
    """Shift points onto the mean line of their neighbours.

    Args:
        cloud: the points.
        radius: radius of the neighbourhood, metres.
        degrees: largest angle between the directions of neighbours.
        rounds: number of shifts.

    Returns:
        Shifted points (point, 3), aligned unit directions (point, 3), and the sum of weights around each (point).
    """
    grid = Cloud(cloud.points, cloud.directions, cloud.weight, radius)
    moved, turned = torch.zeros_like(cloud.points), torch.zeros_like(cloud.directions)
    support = torch.zeros_like(cloud.weight)
    outputs = [kernels.array(moved, wp.vec3), kernels.array(turned, wp.vec3), kernels.array(support)]
    inputs = [*grid.inputs, radius, math.cos(math.radians(degrees)), rounds, *outputs]
    kernels.launch_split(chain_kernels.shift_points, len(moved), inputs, moved.device)
    return moved, turned, support


def grow_chains(cloud: LineCloud, footprint: float, config: ChainConfig, generator: torch.Generator) -> LineSegments:
    """Grow chains from the cloud until every point belongs to one.

    Args:
        cloud: the oriented points.
        footprint: width of a pixel at the hair, metres.
        config: settings, in footprints.
        generator: breaks ties in the order of the seeds.

    Returns:
        One segment per chain; directions follow the points but are otherwise unsigned.
    """
    radius, cell = config.radius * footprint, config.spacing * footprint
    # Sort points so that neighbours in space are neighbours in memory, because a walk reads whole neighbourhoods.
    cloud = cloud.select(torch.argsort(cell_keys(cloud.points, radius)))
    points, directions, _ = mean_shift(cloud, radius, config.angle, config.rounds)
    grid = Cloud(points, directions, cloud.weight, radius)
    keys = cell_keys(points, cell)
    jitter = torch.rand(len(points), generator=generator).to(points)
    order = torch.argsort(cloud.weight + 0.2 * jitter, descending=True)
    parts: list[_Chains] = []
    taken = keys[:0]
    while len(order):
        seeds = _apart(order, points, config.apart * footprint)[: config.batch]
        chains = _walk(grid, seeds, points, directions, radius, footprint, config)
        chains = _trim(chains, cell_keys(chains.points, cell), taken, config.shortest)
        parts.append(chains)
        added = torch.unique(torch.cat([cell_keys(chains.points, cell), keys[seeds]]))
        taken = torch.unique(torch.cat([taken, added]))
        order = order[~_among(keys[order], added)]
    sizes = torch.cat([part.sizes for part in parts]) if parts else keys[:0]
    if len(sizes) == 0:
        return LineSegments(points[:0], directions[:0], cloud.weight[:0], keys[:0])
    support = torch.cat([part.weight for part in parts])
    return LineSegments(
        torch.cat([part.points for part in parts]),
        torch.cat([part.directions for part in parts]),
        support / (support + support.median()),
        torch.repeat_interleave(torch.arange(len(sizes), device=points.device), sizes),
    )


@dataclass(frozen=True)
class _Chains:
    """Concatenated chains, and the number of points of each."""

    points: Float[Tensor, "point 3"]
    directions: Float[Tensor, "point 3"]
    weight: Float[Tensor, " point"]
    sizes: Int64[Tensor, " chain"]


def _walk(
    grid: Cloud, seeds: Tensor, points: Tensor, directions: Tensor, radius: float, footprint: float, config: ChainConfig
) -> _Chains:
    """Grow chains from these seeds, in their order."""
    shape = (len(seeds), 2, config.steps)
    chain, tangent = points.new_zeros(*shape, 3), points.new_zeros(*shape, 3)
    strength = points.new_zeros(shape)
    length = torch.zeros(shape[:2], dtype=torch.int32, device=points.device)
    inputs = [
        *grid.inputs,
        kernels.array(seeds.to(torch.int32)),
        radius,
        config.step * footprint,
        config.support,
        math.cos(math.radians(config.angle)),
        math.cos(math.radians(config.turn)),
        kernels.array(chain, wp.vec3),
        kernels.array(tangent, wp.vec3),
        kernels.array(strength),
        kernels.array(length),
    ]
    kernels.launch_split(chain_kernels.grow, 2 * len(seeds), inputs, points.device)
    # Both directions of a chain in one row: backwards (reversed), the seed, forwards.
    step = torch.arange(config.steps, device=points.device)
    ahead, behind = step < length[:, :1], (step < length[:, 1:]).flip(1)
    kept = torch.cat([behind, length.amax(dim=1, keepdim=True) > 0, ahead], dim=1)
    place = torch.cat([chain[:, 1].flip(1), points[seeds, None], chain[:, 0]], dim=1)
    line = torch.cat([-tangent[:, 1].flip(1), directions[seeds, None], tangent[:, 0]], dim=1)
    weight = torch.cat([strength[:, 1].flip(1), strength[:, :, :1].amax(dim=1), strength[:, 0]], dim=1)
    return _Chains(place[kept], line[kept], weight[kept], kept.sum(dim=1))


def _trim(chains: _Chains, keys: Tensor, taken: Tensor, shortest: int) -> _Chains:
    """Restrict each chain to cells that no earlier chain has taken, and drop pieces that become too short."""
    device = keys.device
    rank = torch.repeat_interleave(torch.arange(len(chains.sizes), device=device), chains.sizes)
    cells, inverse = torch.unique(keys, return_inverse=True)
    first = torch.full((len(cells),), len(chains.sizes), dtype=torch.int64, device=device)
    first.scatter_reduce_(0, inverse, rank, "amin")
    kept = (first[inverse] == rank) & ~_among(keys, taken)
    # A piece begins where a kept point follows a dropped one or another chain.
    begins = kept.clone()
    begins[1:] &= ~kept[:-1] | (rank[1:] != rank[:-1])
    piece = begins.cumsum(0)[kept] - 1
    sizes = torch.bincount(piece)
    long = sizes >= shortest
    index = torch.nonzero(kept).squeeze(1)[long[piece]]
    return _Chains(chains.points[index], chains.directions[index], chains.weight[index], sizes[long])


def _among(keys: Tensor, ordered: Tensor) -> Tensor:
    """Whether keys occur in a sorted list; unlike `torch.isin`, this does not sort again."""
    if len(ordered) == 0:
        return torch.zeros_like(keys, dtype=torch.bool)
    place = torch.searchsorted(ordered, keys).clamp(max=len(ordered) - 1)
    return ordered[place] == keys


def _apart(order: Tensor, points: Tensor, distance: float) -> Tensor:
    """The first of `order` in each cell of `distance` metres."""
    keys = cell_keys(points[order], distance)
    _, inverse = torch.unique(keys, return_inverse=True)
    first = torch.full((int(inverse.max()) + 1,), len(order), dtype=torch.int64, device=points.device)
    first.scatter_reduce_(0, inverse, torch.arange(len(order), device=points.device), "amin")
    return order[first.sort().values]
