"""Line PatchMatch: a depth and a 3D direction for every hair pixel of a view (Nam et al. 2019, section 4).

Each pixel's hypothesis is a 3D line through a point on its ray. It starts from a sweep of depths, with the direction on
which the views' 2D orientations agree. The pixel then adopts lines of neighbours and perturbs its own, in red-black
half sweeps, coarse to fine. Views are compared along the line and a few pixels to either side.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import torch
import warp as wp
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.foundation import kernels as launches
from neural_strands.foundation.configs import Between
from neural_strands.lmvs.features import Features, ray_angle
from neural_strands.lmvs.kernels import patchmatch as patchmatch_kernels
from neural_strands.lmvs.kernels.ribbons import MOST_NEIGHBOURS, MOST_SAMPLES, Patch
from neural_strands.lmvs.search_range import Bounds
from neural_strands.raster.gaussian_blur import gaussian_blur

CROSS = ((0, -1), (0, 1), (-1, 0), (1, 0))
"""Nearest neighbours of a pixel, all of the other colour (red-black), in steps of the level."""
KNIGHT = ((0, -3), (0, 3), (-3, 0), (3, 0))
"""Further neighbours, also of the other colour."""


@dataclass(frozen=True)
class Level:
    """Settings of one level, from coarse to fine."""

    stride: Annotated[int, Between(1, 64)]
    """Spacing of the pixels that are solved, in x and y."""
    sweeps: Annotated[int, Between(0, 100)]
    """Red and black sweeps."""
    trials: Annotated[int, Between(0, 100)]
    """Perturbations per pixel and sweep."""
    along: Annotated[int, Between(0, 64)]
    """Samples to each side along the line."""
    across: Annotated[int, Between(0, 64)]
    """Samples to each side across it."""
    step: Annotated[float, Between(0.01, 100)]
    """Distance of samples, pixels."""
    depth_range: Annotated[float, Between(0, 1000)]
    """Largest perturbation of the depth, pixel footprints."""
    angle_range: Annotated[float, Between(0, 2)]
    """Largest perturbation of the direction, on the unit sphere."""

    def __post_init__(self) -> None:
        """Reject a ribbon that is too large for the kernels."""
        samples = (2 * self.along + 1) * (2 * self.across + 1)
        if samples > MOST_SAMPLES:
            raise ValueError(
                f"a ribbon has at most {MOST_SAMPLES} samples, found {samples}: lessen `along` or `across`"
            )


LEVELS = (
    Level(4, 2, 3, 4, 2, 1.5, 3.0, 0.2),
    Level(2, 1, 2, 4, 2, 1.5, 6.0, 0.1),
    Level(1, 1, 3, 3, 1, 1.5, 15.0, 0.05),
)


@dataclass(frozen=True)
class PatchMatchConfig:
    """Settings of the search."""

    levels: tuple[Level, ...] = LEVELS
    """Coarse to fine."""
    depth_step: Annotated[float, Between(0.1, 1000)] = 3.2
    """Spacing of the depths that the first sweep tries, pixel footprints."""
    smooth: Annotated[float, Between(0, 100)] = 1.0
    """Standard deviation over which the first sweep's costs are averaged between pixels, in strides of the first level.

    A single ribbon of sub-pixel hair hardly determines depth; a neighbourhood locates the surface of the hair to within
    a few millimetres."""
    sink: Annotated[float, Between(0, 1)] = 0.05
    """Cost added at the largest depth behind the hull's surface: hair seen deep through a gap is rare."""
    shallow: Annotated[float, Between(0, 1)] = 0.2
    """Share of that depth without added cost."""
    intensity: Annotated[float, Between(0, 1)] = 0.5
    """Weight of 1 - NCC against the orientation's cost."""
    best: Annotated[int, Between(1, MOST_NEIGHBOURS)] = 6
    """Number of best neighbours whose mean is the cost of a line."""


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
    """Reference and neighbours in the form that kernels read."""

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
    """Find the lines of the pixels of a view.

    Args:
        reference: the view.
        neighbours: the other views; at most `MOST_NEIGHBOURS` of them are used.
        pixel: columns and rows of hair pixels.
        bounds: search range of each pixel's ray.
        thickness: largest length of a search range, metres.
        config: settings of the search.
        seed: seed of the perturbations.

    Returns:
        The lines of all pixels for which one was found.
    """
    views = _stack([reference, *neighbours[:MOST_NEIGHBOURS]])
    ray = reference.camera.rays(pixel.float() + 0.5)
    depth, direction = torch.zeros_like(bounds.near), torch.zeros_like(ray)
    cost = torch.full_like(bounds.near, 4.0)
    if not on_grid(pixel, config.levels[0].stride, config).any():
        # The mask has too few pixels for the coarsest level.
        return LineMap(pixel[:0], depth[:0], direction[:0], cost[:0])
    previous = None
    for level in config.levels:
        chosen = torch.nonzero(on_grid(pixel, level.stride, config)).squeeze(1)
        part = _Part(pixel[chosen], ray[chosen], bounds.select(chosen), ray_angle(reference.camera), level)
        if previous is None:
            depths = math.ceil(thickness / (config.depth_step * part.footprint)) + 1
            offset = thickness * torch.linspace(0, 1, depths, device=ray.device)
            depth[chosen] = _surface(views, part, offset, config)
            direction[chosen] = _agreed_directions(views, part, depth[chosen], config)
        else:
            source = _nearest_solved(pixel[chosen], pixel[previous], level.stride * 2)
            _inherit_lines(ray, chosen, previous, source, depth, direction)
        state = depth[chosen], direction[chosen], torch.full_like(depth[chosen], 4.0)
        _improve(views, part, config, seed, state)
        depth[chosen], direction[chosen], cost[chosen] = state
        previous = chosen
    keep = torch.nonzero(cost < 2).squeeze(1)
    return LineMap(pixel[keep], depth[keep], direction[keep], cost[keep])


def on_grid(pixel: Int64[Tensor, "point 2"], stride: int, config: PatchMatchConfig) -> Bool[Tensor, " point"]:
    """Mark the pixels that a level of this stride solves; each level's pixels are a subset of the next one's."""
    first = min(level.stride for level in config.levels) // 2
    return ((pixel % stride) == first).all(dim=1)


@dataclass(frozen=True)
class _Part:
    """The pixels that a level solves."""

    pixel: Int64[Tensor, "point 2"]
    ray: Float[Tensor, "point 3"]
    bounds: Bounds
    angle: float
    level: Level

    @property
    def footprint(self) -> float:
        """Width of a pixel at the hair, metres."""
        return float(self.bounds.near.median()) * self.angle if len(self.ray) else 1.0


def _scene(views: _Stack, part: _Part, config: PatchMatchConfig) -> list:
    """The inputs from the views that every kernel takes, in this order."""
    count, level = len(views.texture) - 1, part.level
    patch = Patch()
    patch.along, patch.across, patch.step = level.along, level.across, level.step
    patch.intensity, patch.best, patch.views = config.intensity, min(config.best, count), count
    patch.height, patch.width = views.texture.shape[1:3]
    return [
        launches.array(views.texture.reshape(-1, 4), wp.vec4),
        launches.array(views.projection, wp.mat44),
        launches.array(views.centre, wp.vec3),
        launches.array(views.plane, wp.mat33),
        patch,
    ]


def _surface(
    views: _Stack, part: _Part, offset: Float[Tensor, " depth"], config: PatchMatchConfig
) -> Float[Tensor, " point"]:
    """Sweep depths, and return for each pixel the depth on which its neighbourhood agrees."""
    cost = torch.zeros(len(part.ray), len(offset), device=part.ray.device)
    rays = [launches.array(part.ray, wp.vec3), launches.array(part.bounds.normal, wp.vec3)]
    limits = [launches.array(part.bounds.near), launches.array(part.bounds.far), launches.array(offset)]
    inputs = [*rays, *limits, part.angle, *_scene(views, part, config), launches.array(cost)]
    launches.launch_split(patchmatch_kernels.sweep, len(part.ray), inputs, part.ray.device)
    cell = torch.div(part.pixel, part.level.stride, rounding_mode="floor")
    cell = cell - cell.amin(dim=0)
    width, height = (cell.amax(dim=0) + 1).tolist()
    valid = cost >= 0
    volume = cost.new_zeros(2, len(offset), height, width)
    volume[0][:, cell[:, 1], cell[:, 0]] = torch.where(valid, cost, 0.0).T
    volume[1][:, cell[:, 1], cell[:, 0]] = valid.float().T
    volume = gaussian_blur(volume, config.smooth)
    mean = (volume[0] / volume[1].clamp(min=1e-6))[:, cell[:, 1], cell[:, 0]].T
    deep = (offset / offset[-1] - config.shallow).clamp(min=0)
    mean = torch.where(valid, mean + config.sink * deep, 9.0)
    index = mean.argmin(dim=1, keepdim=True)
    return part.bounds.near + offset[index[:, 0]]


def _agreed_directions(
    views: _Stack, part: _Part, depth: Float[Tensor, " point"], config: PatchMatchConfig
) -> Float[Tensor, "point 3"]:
    """Directions on which the views agree at these depths."""
    direction = torch.zeros_like(part.ray)
    outputs = [launches.array(depth), launches.array(direction, wp.vec3)]
    inputs = [launches.array(part.ray, wp.vec3), *_scene(views, part, config), *outputs]
    launches.launch_split(patchmatch_kernels.look, len(part.ray), inputs, part.ray.device)
    return direction


def _improve(
    views: _Stack,
    part: _Part,
    config: PatchMatchConfig,
    seed: int,
    state: tuple[Tensor, Tensor, Tensor],
) -> None:
    """Run the red-black half sweeps of one level; `state` (depth, direction, cost) is updated in place."""
    level = part.level
    results = [launches.array(state[0]), launches.array(state[1], wp.vec3), launches.array(state[2])]
    rays = [launches.array(part.ray, wp.vec3), launches.array(part.bounds.normal, wp.vec3)]
    limits = [launches.array(part.bounds.near), launches.array(part.bounds.far)]
    adjacent = launches.array(_adjacency(part.pixel, level.stride))
    cell = torch.div(part.pixel, level.stride, rounding_mode="floor")
    colours = [torch.nonzero(cell.sum(dim=1) % 2 == c).squeeze(1).to(torch.int32) for c in (0, 1)]
    for sweep in range(level.sweeps):
        shrink = 0.6**sweep
        for number, colour in enumerate(colours):
            moves = [level.trials, level.depth_range * part.footprint * shrink, level.angle_range * shrink]
            numbers = [*moves, seed + 2 * sweep + number, part.angle]
            inputs = [
                launches.array(colour),
                adjacent,
                *rays,
                *limits,
                *numbers,
                *_scene(views, part, config),
                *results,
            ]
            launches.launch_split(patchmatch_kernels.improve, len(colour), inputs, part.ray.device)


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
    """Indices (int32) of each pixel's neighbours in the level's grid, -1 if there is none."""
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


def _inherit_lines(
    ray: Tensor, chosen: Tensor, previous: Tensor, source: Tensor, depth: Tensor, direction: Tensor
) -> None:
    """Initialise each chosen pixel with the line of its coarse neighbour; pixels without one get the median depth."""
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
