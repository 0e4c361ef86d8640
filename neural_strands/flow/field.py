"""Growth directions everywhere in the hair: those of the segments, diffused inwards (Laplace's equation).

The segments cover the visible shell only. Between them and the scalp the direction is the smoothest one that agrees
with both: the mean of its neighbours, with the segments' directions fixed and the scalp pulling towards its normal.
"""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.faces import face_neighbours, neighbour_mean
from neural_strands.flow.filling import average, pull_push
from neural_strands.flow.unseen import UnseenHair, along_head, marked
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import Track, untracked
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.voxel_grid import VoxelGrid

MOST_VOXELS = 50_000_000
"""Largest number of voxels, so that the grid fits into memory."""


@dataclass(frozen=True)
class FlowConfig:
    """The volume and its diffusion."""

    spacing: Annotated[float, Between(1e-5, 1)] = 0.002
    """Edge of a voxel, metres."""
    margin: Annotated[float, Between(0, 1)] = 0.02
    """Margin of the box around segments and roots, metres."""
    iterations: Annotated[int, Between(0, 100_000)] = 25
    """Jacobi sweeps after the multigrid start. They smooth over about the square root of their number in voxels: with
    too few, the blocks of the coarse start remain visible; with many, layers of hair blur into each other."""
    normal_pull: Annotated[float, Between(0, 1)] = 0.25
    """Weight, from 0 to 1, of the scalp's normal against the flow above it in directions next to the scalp."""
    scalp_layer: Annotated[float, Between(0, 1)] = 0.003
    """Thickness of the layer in which the scalp's normal counts, metres."""
    least_confidence: Annotated[float, Between(0, 1)] = 0.3
    """Segment points less confident than this are ignored; half of all points have 0.5 or more, guesses have 0.1."""


@dataclass(frozen=True)
class FlowField:
    """A direction for every voxel.

    Attributes:
        grid: the voxels.
        directions: unit growth directions.
        domain: where there can be hair.
        unseen: the part of the domain that no view sees; None if views see all of it.
        measured: voxels whose direction comes from segments; None if there are none.
    """

    grid: VoxelGrid
    directions: Float[Tensor, "x y z 3"]
    domain: Bool[Tensor, "x y z"]
    unseen: Bool[Tensor, "x y z"] | None = None
    measured: Bool[Tensor, "x y z"] | None = None

    def at(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
        """Growth directions at points, interpolated, so shorter than 1; outside the grid, those of its border."""
        return self.grid.sample(self.directions, points, outside="border")


def grid_around(points: Float[Tensor, "point 3"], spacing: float, margin: float) -> VoxelGrid:
    """The grid that contains `points` with `margin` metres on every side.

    Raises:
        InputError: the box would have more than `MOST_VOXELS` voxels.
    """
    low, high = (points.amin(dim=0) - margin).tolist(), (points.amax(dim=0) + margin).tolist()
    grid = VoxelGrid.filling(low, high, spacing)
    if grid.count > MOST_VOXELS:
        extent = " x ".join(f"{end - start:.2f}" for start, end in zip(low, high, strict=True))
        raise InputError(
            f"the hair spans {extent} m, expected a head's size in metres at {1000 * spacing:g} mm a voxel; "
            "check the capture's scale, or remove stray segments."
        )
    return grid


def diffuse_directions(
    grid: VoxelGrid,
    domain: Bool[Tensor, "x y z"],
    segments: LineSegments,
    scalp_points: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    config: FlowConfig | None = None,
    guess: UnseenHair | None = None,
    track: Track = untracked,
) -> FlowField:
    """Solve for the growth direction in every voxel of the domain.

    Args:
        grid: the voxels.
        domain: where there can be hair.
        segments: oriented points, signed from root to tip.
        scalp_points: a dense sample of the scalp.
        scalp_normals: its outward normals.
        config: weights and sweeps.
        guess: directions of hair that no view sees, if they were extrapolated.
        track: shows the progress of the sweeps.
    """
    config = config or FlowConfig()
    kept = segments.confidence >= config.least_confidence
    shell, weight = average(grid, segments.points[kept], segments.directions[kept], segments.confidence[kept])
    fixed, shell = weight > 0, functional.normalize(shell, dim=-1)
    lifted = scalp_points + 0.5 * config.scalp_layer * scalp_normals
    normal, normal_weight = average(grid, lifted, scalp_normals, torch.ones_like(scalp_points[:, 0]))
    pulled, normal = (normal_weight > 0) & ~fixed, functional.normalize(normal, dim=-1)
    domain = domain | fixed | pulled
    start = pull_push(shell, fixed.to(shell)).reshape(-1, 3)
    if guess is not None:
        start[guess.voxels] = guess.directions
    cells = torch.nonzero(domain.reshape(-1)).squeeze(1)
    neighbours = face_neighbours(domain)
    value, known, normals = (volume.reshape(-1, 3)[cells] for volume in (start, shell, normal))
    is_fixed, is_pulled = (mask.reshape(-1)[cells, None] for mask in (fixed, pulled))
    value = functional.normalize(value, dim=-1)
    lying = None if guess is None else torch.searchsorted(cells, guess.voxels)
    for _ in track(range(config.iterations), "smoothing growth directions", config.iterations):
        mean = neighbour_mean(value, neighbours)
        if guess is not None:
            mean[lying] = along_head(mean[lying], guess.place)
        strength = mean.norm(dim=-1, keepdim=True).clamp(min=0.3)
        towards_normal = (1 - config.normal_pull) * mean + config.normal_pull * strength * normals
        value = torch.where(is_fixed, known, torch.where(is_pulled, towards_normal, mean))
    # Outside the domain the multigrid start remains, for streamlines that graze the border.
    directions = start.index_copy(0, cells, functional.normalize(value, dim=-1)).reshape(*grid.shape, 3)
    unseen = None if guess is None else marked(domain, guess.voxels)
    return FlowField(grid, directions, domain, unseen, fixed)
