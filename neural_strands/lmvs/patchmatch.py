"""Line PatchMatch: a depth and a 3D direction for every hair pixel of a view (Nam et al. 2019, section 4).

Each pixel's hypothesis is a 3D line through a point on its ray. It starts from a sweep of depths in which the direction
is the one that the views' 2D orientations agree on, then takes over neighbours' lines and perturbs its own, in red and
black half sweeps, coarse to fine. A line is compared between views along itself and a few pixels to both sides.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation import kernels as launches
from neural_strands.lmvs import kernels
from neural_strands.lmvs.bounds import Bounds
from neural_strands.lmvs.features import Features, ray_angle

MOST_NEIGHBOURS = 8
"""Neighbour views that the kernels have room for."""
CROSS = ((0, -1), (0, 1), (-1, 0), (1, 0))
"""Red-black neighbours of a pixel, in steps of the level."""
KNIGHT = ((0, -3), (0, 3), (-3, 0), (3, 0))
"""Further ones, of the other colour as well."""


@dataclass(frozen=True)
class Level:
    """One step from coarse to fine."""

    stride: int
    """Every how many-th pixel in x and y is solved."""
    sweeps: int
    """Red and black sweeps."""
    trials: int
    """Perturbations a pixel and sweep."""
    along: int
    """Samples to each side along the line."""
    across: int
    """Samples to each side across it."""
    step: float
    """Distance of samples, pixels."""
    depth_range: float
    """Largest perturbation of the depth, pixel footprints."""
    angle_range: float
    """Largest perturbation of the direction, on the unit sphere."""


LEVELS = (
    Level(4, 3, 4, 4, 2, 2.0, 6.0, 0.3),
    Level(2, 2, 2, 4, 2, 1.5, 2.0, 0.15),
    Level(1, 1, 1, 4, 1, 1.5, 1.0, 0.05),
)


@dataclass(frozen=True)
class PatchMatchConfig:
    """The search."""

    levels: tuple[Level, ...] = LEVELS
    """Coarse to fine."""
    depths: int = 24
    """Depths that the first sweep tries."""
    intensity: float = 0.5
    """Weight of 1 - NCC against the orientation's cost."""
    prior: float = 0.25
    """Cost of lying as deep behind the hull's surface as the search goes (linear in depth)."""
    best: int = 3
    """Neighbours, the best ones, that a line's cost is the mean of."""


@dataclass(frozen=True)
class LineMap:
    """Lines of a view's hair pixels.

    Attributes:
        pixel: column and row.
        depth: distance from the camera's centre along the pixel's ray, metres.
        direction: unit, unsigned.
        cost: in [0, 1], 0 best.
    """

    pixel: Int64[Tensor, "point 2"]
    depth: Float[Tensor, " point"]
    direction: Float[Tensor, "point 3"]
    cost: Float[Tensor, " point"]


@dataclass(frozen=True)
class _Stack:
    """Reference and neighbours as the kernels take them."""

    texture: Float[Tensor, "view height width 4"]
    projection: Float[Tensor, "view 4 4"]
    centre: Float[Tensor, "view 3"]
    plane: Float[Tensor, "view 3 3"]


def match_lines(
    reference: Features,
    neighbours: Sequence[Features],
    pixel: Int64[Tensor, "point 2"],
    bounds: Bounds,
    thickness: float,
    config: PatchMatchConfig,
    seed: int,
) -> LineMap:
    """Find the lines of the pixels of a view, given where each one's ray may look (`thickness` metres at most)."""
    stack = _stack([reference, *neighbours[:MOST_NEIGHBOURS]])
    ray = reference.camera.rays(pixel.float() + 0.5)
    depth, cost = torch.zeros_like(bounds.near), torch.full_like(bounds.near, 4.0)
    direction = torch.zeros_like(ray)
    previous = None
    for level in config.levels:
        chosen = torch.nonzero(((pixel % level.stride) == level.stride // 2).all(dim=1)).squeeze(1)
        if previous is not None:
            source = _nearest_solved(pixel[chosen], pixel[previous], level.stride * 2)
            _take_over(ray, chosen, previous, source, depth, direction)
        part = Bounds(bounds.near[chosen], bounds.far[chosen], bounds.normal[chosen])
        state = depth[chosen], direction[chosen], torch.full((len(chosen),), 4.0, device=ray.device)
        _solve(
            stack, reference, pixel[chosen], ray[chosen], part, level, config, thickness, previous is None, seed, state
        )
        depth[chosen], direction[chosen], cost[chosen] = state
        previous = chosen
    keep = torch.nonzero(cost < 2).squeeze(1)
    return LineMap(pixel[keep], depth[keep], direction[keep], cost[keep])


def _solve(
    stack: _Stack,
    reference: Features,
    pixel: Tensor,
    ray: Tensor,
    bounds: Bounds,
    level: Level,
    config: PatchMatchConfig,
    thickness: float,
    first: bool,
    seed: int,
    state: tuple[Tensor, Tensor, Tensor],
) -> None:
    """Run one level; `state` (depth, direction, cost) is changed in place."""
    views = len(stack.texture) - 1
    patch = kernels.Patch()
    patch.along, patch.across, patch.step = level.along, level.across, level.step
    patch.intensity, patch.best, patch.views = config.intensity, min(config.best, views), views
    patch.prior = config.prior / thickness
    patch.height, patch.width = stack.texture.shape[1:3]
    angle = ray_angle(reference.camera)
    scene = [
        launches.array(stack.texture, wp.vec4),
        launches.array(stack.projection, wp.mat44),
        launches.array(stack.centre, wp.vec3),
        launches.array(stack.plane, wp.mat33),
        patch,
        launches.array(state[0]),
        launches.array(state[1], wp.vec3),
        launches.array(state[2]),
    ]
    rays = [launches.array(ray, wp.vec3), launches.array(bounds.normal, wp.vec3)]
    limits = [launches.array(bounds.near), launches.array(bounds.far)]
    if first:
        inputs = [*rays, *limits, config.depths, angle, *scene]
        launches.launch_split(kernels.sweep, len(pixel), inputs, ray.device)
    adjacent = launches.array(_adjacency(pixel, level.stride))
    cell = pixel // level.stride
    colours = [torch.nonzero(cell.sum(dim=1) % 2 == c).squeeze(1).to(torch.int32) for c in (0, 1)]
    footprint = float(bounds.near.median()) * angle if len(pixel) else 0.0
    for sweep in range(level.sweeps):
        shrink = 0.6**sweep
        for number, colour in enumerate(colours):
            moves = [level.trials, level.depth_range * footprint * shrink, level.angle_range * shrink]
            inputs = [
                launches.array(colour),
                adjacent,
                *rays,
                *limits,
                *moves,
                seed + 2 * sweep + number,
                angle,
                *scene,
            ]
            launches.launch_split(kernels.improve, len(colour), inputs, ray.device)


def _stack(features: Sequence[Features]) -> _Stack:
    """Textures padded to one size, and the matrices that the kernels need."""
    height = max(one.texture.shape[0] for one in features)
    width = max(one.texture.shape[1] for one in features)
    device = features[0].texture.device
    texture = torch.zeros(len(features), height, width, 4, device=device)
    projection = torch.eye(4, device=device).repeat(len(features), 1, 1)
    for i, one in enumerate(features):
        texture[i, : one.texture.shape[0], : one.texture.shape[1]] = one.texture
        projection[i, :3] = one.camera.intrinsics @ one.camera.world_to_camera[:3]
    centre = torch.stack([one.camera.position for one in features])
    plane = torch.stack([(one.camera.intrinsics @ one.camera.rotation).T for one in features])
    return _Stack(texture, projection, centre, plane)


def _adjacency(pixel: Int64[Tensor, "point 2"], stride: int) -> Tensor:
    """Indices (int32) of each pixel's neighbours in the level's grid, -1 where there is none."""
    cell = torch.div(pixel, stride, rounding_mode="floor") + 3
    width, height = (int(v) + 4 for v in cell.amax(dim=0)) if len(cell) else (4, 4)
    index = torch.full((height, width), -1, dtype=torch.int32, device=pixel.device)
    index[cell[:, 1], cell[:, 0]] = torch.arange(len(cell), dtype=torch.int32, device=pixel.device)
    return torch.stack([index[cell[:, 1] + y, cell[:, 0] + x] for x, y in (*CROSS, *KNIGHT)], dim=1)


def _nearest_solved(pixel: Tensor, solved: Tensor, stride: int) -> Int64[Tensor, " point"]:
    """Index of a solved pixel in the coarse cell nearest to each pixel (-1 if none within two cells)."""
    margin = 2
    cell = torch.div(pixel, stride, rounding_mode="floor") + margin
    coarse = torch.div(solved, stride, rounding_mode="floor") + margin
    size = torch.cat([cell, coarse]).amax(dim=0) + margin + 1
    index = torch.full((int(size[1]), int(size[0])), -1, dtype=torch.int64, device=pixel.device)
    index[coarse[:, 1], coarse[:, 0]] = torch.arange(len(coarse), device=pixel.device)
    found = index[cell[:, 1], cell[:, 0]]
    order = sorted(((x, y) for x in range(-2, 3) for y in range(-2, 3)), key=lambda xy: xy[0] ** 2 + xy[1] ** 2)
    for x, y in order:
        other = index[cell[:, 1] + y, cell[:, 0] + x]
        found = torch.where(found < 0, other, found)
    return found


def _take_over(ray: Tensor, chosen: Tensor, previous: Tensor, source: Tensor, depth: Tensor, direction: Tensor) -> None:
    """Give each chosen pixel its coarse neighbour's line; those without one get the median depth."""
    own = ray[chosen]
    with_source = previous[source.clamp(min=0)]
    line, base = direction[with_source], ray[with_source] * depth[with_source, None]
    along = (line * own).sum(-1)
    slack = 1 - along**2
    distance = (base * (own - line * along[:, None])).sum(-1) / slack.clamp(min=1e-6)
    kept = depth[with_source]
    distance = torch.where((slack > 0.03) & ((distance - kept).abs() < 0.05 * kept), distance, kept)
    depth[chosen] = torch.where(source >= 0, distance, depth[previous].median())
    direction[chosen] = line
