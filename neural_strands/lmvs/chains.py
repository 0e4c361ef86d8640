"""From an oriented point cloud to chains of points: mean shift, then growing (Nam et al. 2019, section 5)."""

import math
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs import chain_kernels
from neural_strands.lmvs.consistency import OrientedPoints


@dataclass(frozen=True)
class ChainConfig:
    """Lengths in pixel footprints, angles in degrees."""

    radius: float = 2.5
    """Reach of the mean shift."""
    rounds: int = 2
    """Mean shifts of every point before chains grow."""
    angle: float = 25.0
    """Neighbours of a larger angle are another strand."""
    turn: float = 20.0
    """Largest turn of a chain from one point to the next."""
    step: float = 1.0
    """Distance of a chain's points."""
    spacing: float = 1.2
    """Points nearer than this to a chain belong to it and start no other."""
    support: float = 1.5
    """Least sum of weights about a chain's point."""
    steps: int = 60
    """Points a chain grows each way at most."""
    shortest: int = 6
    """Chains of fewer points are dropped."""
    batch: int = 8192
    """Seeds grown at once."""


class Cloud:
    """An oriented cloud in a hash grid."""

    def __init__(self, points: Tensor, directions: Tensor, weight: Tensor, radius: float) -> None:
        """Sort the points into cells of `radius` metres."""
        kernels.start_warp()
        self.device = points.device
        self.place, self.line = kernels.array(points, wp.vec3), kernels.array(directions, wp.vec3)
        self.weight = kernels.array(weight)
        self.grid = wp.HashGrid(128, 128, 128, device=str(self.place.device))
        self.grid.build(self.place, radius)
        self.inputs = [self.grid.id, self.place, self.line, self.weight]


def mean_shift(cloud: OrientedPoints, radius: float, degrees: float, rounds: int) -> tuple[Tensor, Tensor, Tensor]:
    """Shifted points, turned directions and the weight about each."""
    grid = Cloud(cloud.points, cloud.directions, cloud.weight, radius)
    moved, turned = torch.zeros_like(cloud.points), torch.zeros_like(cloud.directions)
    support = torch.zeros_like(cloud.weight)
    outputs = [kernels.array(moved, wp.vec3), kernels.array(turned, wp.vec3), kernels.array(support)]
    inputs = [*grid.inputs, radius, math.cos(math.radians(degrees)), rounds, *outputs]
    kernels.launch_split(chain_kernels.shift_points, len(moved), inputs, moved.device)
    return moved, turned, support


def grow_chains(
    cloud: OrientedPoints, footprint: float, config: ChainConfig, generator: torch.Generator
) -> LineSegments:
    """Grow chains from the cloud until every point belongs to one."""
    radius = config.radius * footprint
    points, directions, _ = mean_shift(cloud, radius, config.angle, config.rounds)
    grid = Cloud(points, directions, cloud.weight, radius)
    cell = config.spacing * footprint
    free = torch.ones(len(points), dtype=torch.bool, device=points.device)
    keys = _cell_keys(points, cell)
    order = torch.argsort(cloud.weight + 0.2 * torch.rand(len(points), generator=generator), descending=True)
    parts: list[tuple[Tensor, Tensor, Tensor]] = []
    taken = torch.zeros(0, dtype=torch.int64)
    while True:
        seeds = order[free[order]]
        if len(seeds) == 0:
            break
        seeds = _apart(seeds, points, 6 * footprint)[: config.batch]
        free[seeds] = False
        chains = _walk(grid, seeds, points, directions, radius, footprint, config)
        parts.extend(chains)
        if chains:
            taken = torch.unique(torch.cat([_cell_keys(chain[0], cell) for chain in chains]))
            free &= ~torch.isin(keys, taken)
    if not parts:
        return LineSegments(points[:0], directions[:0], cloud.weight[:0], torch.zeros(0, dtype=torch.int64))
    sizes = torch.tensor([len(part[0]) for part in parts])
    support = torch.cat([part[2] for part in parts])
    return LineSegments(
        torch.cat([part[0] for part in parts]),
        torch.cat([part[1] for part in parts]),
        support / (support + support.median()),
        torch.repeat_interleave(torch.arange(len(parts)), sizes),
    )


def _walk(
    grid: Cloud, seeds: Tensor, points: Tensor, directions: Tensor, radius: float, footprint: float, config: ChainConfig
) -> list[tuple[Tensor, Tensor, Tensor]]:
    """Chains (points, directions, weights) from these seeds, those long enough."""
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
    result = []
    for k, (ahead, behind) in enumerate(length.tolist()):
        if ahead + behind + 1 < config.shortest:
            continue
        seed = seeds[k : k + 1]
        place = torch.cat([chain[k, 1, :behind].flip(0), points[seed], chain[k, 0, :ahead]])
        line = torch.cat([-tangent[k, 1, :behind].flip(0), directions[seed], tangent[k, 0, :ahead]])
        weight = torch.cat([strength[k, 1, :behind].flip(0), strength[k, :, 0].max()[None], strength[k, 0, :ahead]])
        result.append((place, line, weight))
    return result


def _cell_keys(points: Float[Tensor, "point 3"], cell: float) -> Tensor:
    """One number for the cell that each point lies in."""
    index = torch.floor(points / cell).long() + 2**20
    return (index[:, 0] << 42) + (index[:, 1] << 21) + index[:, 2]


def _apart(order: Tensor, points: Tensor, distance: float) -> Tensor:
    """The first of `order` in each cell of `distance` metres."""
    keys = _cell_keys(points[order], distance)
    _, inverse = torch.unique(keys, return_inverse=True)
    first = torch.full((int(inverse.max()) + 1,), len(order), dtype=torch.int64, device=points.device)
    first.scatter_reduce_(0, inverse, torch.arange(len(order), device=points.device), "amin")
    return order[first.sort().values]
