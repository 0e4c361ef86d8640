"""Find out whether hair is curly, and how large its curls are, by drawing it (analysis by synthesis).

Segments that all lean to one side of the hair's hanging course are the first sign of curls. Turned back, they show the
course of the curls' axes. Strands along it are then wound with many radii and pitches, drawn, and compared with the
photographs by their texture; the hair is curly if one of them looks more like the photographs than straight strands do.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.fitting.curls.texture import course_of, drawn_hair, texture_of
from neural_strands.flow.curls import (
    Curl,
    CurlConfig,
    Lean,
    curled,
    lock_phases,
    mean_lean,
    surface_normals,
    turned_back,
)
from neural_strands.flow.field import FlowField
from neural_strands.flow.hair_flow import HairRoom, InitialConfig, hair_flow, hanging_flow
from neural_strands.flow.tracing import TracedStrands, trace_hair
from neural_strands.flow.unseen import DOWN
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.resample import resample_strands
from neural_strands.geometry.views import Views
from neural_strands.lmvs.orientation import OrientationConfig, luma

MOST_STRANDS = 5000
"""Largest number of strands that are drawn."""
MOST_VIEWS = 4
"""Largest number of views that drawn hair is compared with."""
LARGEST_SIDE = 512
"""Photographs are reduced to this size for the comparison, pixels."""
SLOPES = (0.4, 0.55, 0.7, 0.9, 1.12, 1.4, 1.75)
"""Slopes of curls that are tried: 2 pi radius / pitch."""
PITCHES = (0.012, 0.0155, 0.02, 0.024, 0.028, 0.034, 0.04, 0.05, 0.064)
"""Lengths of a turn that are tried, metres."""
FIRST_INSET = 0.004
"""Depth of the axes below the surface of the hair while the radius is unknown, metres."""
LEVEL = 0.8
"""Places where the surface of the hair is more level than this (vertical part of its normal) do not show gravity."""
LEAST_GAIN = 0.15
"""By how much the texture of curls must come closer to the photographs than that of straight hair."""


@dataclass(frozen=True)
class FoundCurls:
    """Curly hair.

    Attributes:
        curl: size and handedness of its curls.
        axes: the flow along their axes.
    """

    curl: Curl
    axes: FlowField


@dataclass(frozen=True)
class Photographs:
    """Photographs with which drawn hair is compared.

    Attributes:
        cameras: cameras of the reduced pictures.
        brightness: the pictures.
        masks: coverage of hair.
    """

    cameras: Sequence[Camera]
    brightness: Sequence[Float[Tensor, "height width"]]
    masks: Sequence[Float[Tensor, "height width"]]


def find_curls(
    room: HairRoom,
    segments: LineSegments,
    views: Views,
    scalp_points: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    config: InitialConfig,
) -> FoundCurls | None:
    """Look for curls that all turn alike; None if the hair is not curly, or if no view has a hair mask.

    Args:
        room: where hair can be.
        segments: line segments of the hair.
        views: the photographs.
        scalp_points: roots of the hair.
        scalp_normals: outward unit normals there.
        config: settings of the initial strands.
    """
    kept = segments.select(segments.confidence >= config.flow.least_confidence)
    if not config.curls.find or not room.masked or not _is_strong(lean_off_gravity(room, kept), config.curls):
        return None
    scalp = scalp_points, scalp_normals
    course = hanging_flow(room, kept, *scalp, config)
    lean = lean_off(course, kept)
    if not _is_strong(lean, config.curls):
        return None
    straight = turned_back(kept, course, lean.angle)
    along = replace(config, conservation=replace(config.conservation, way_out=config.curls.way_out))
    axes = hair_flow(room.inset(FIRST_INSET), straight, *scalp, along)
    traced = trace_hair(axes, *scalp, config.trace).points
    curl = closest_curl(traced, scalp_normals, photographs(views), -round(math.copysign(1, lean.angle)), config.curls)
    if curl is None:
        return None
    if abs(curl.radius - FIRST_INSET) > room.grid.spacing:
        axes = hair_flow(room.inset(curl.radius), straight, *scalp, along)
    return FoundCurls(curl, axes)


def curl_strands(
    found: FoundCurls,
    roots: Float[Tensor, "root 3"],
    normals: Float[Tensor, "root 3"],
    distance: SignedDistanceGrid,
    config: InitialConfig,
) -> TracedStrands:
    """Trace strands along the axes of curls and wind them.

    Args:
        found: the curls and the flow along their axes.
        roots: where strands start, metres.
        normals: outward unit normals there.
        distance: signed distance to the head, which strands keep clear of.
        config: settings of the initial strands.
    """
    axes = trace_hair(found.axes, roots, normals, config.trace)
    points = curled(axes.points, normals, lock_phases(roots, config.curls.lock), found.curl, distance)
    return replace(axes, points=resample_strands(points, config.trace.points))


def lean_off(course: FlowField, segments: LineSegments) -> Lean:
    """How segments lean off the course of the hair."""
    axes = course.grid.sample(course.directions, segments.points, outside="border")
    return mean_lean(segments.directions, axes, surface_normals(course.grid, course.domain, segments.points))


def lean_off_gravity(room: HairRoom, segments: LineSegments) -> Lean:
    """How segments lean off the vertical where the surface of the hair is steep; quick, because it needs no flow."""
    normals = surface_normals(room.grid, room.domain, segments.points)
    steep = normals[:, 1].abs() < LEVEL
    down = normals.new_tensor(DOWN).expand(int(steep.sum()), 3)
    return mean_lean(segments.directions[steep], down, normals[steep])


def photographs(views: Views) -> Photographs:
    """A few photographs from all around, reduced to the size at which they are compared."""
    masked = [index for index, has in enumerate(views.has_hair_mask) if has]
    chosen = masked[:: max(1, len(masked) // MOST_VIEWS)][:MOST_VIEWS]
    cameras, brightness, masks = [], [], []
    for view in (views[index] for index in chosen):
        if view.hair_mask is None:
            continue
        scale = min(1.0, LARGEST_SIDE / max(view.camera.width, view.camera.height))
        small = view.camera.resized(round(scale * view.camera.width) or 1, round(scale * view.camera.height) or 1)
        layers = torch.stack([luma(view.image), view.hair_mask])[None]
        picture, mask = functional.interpolate(layers, (small.height, small.width), mode="area")[0]
        cameras.append(small)
        brightness.append(picture)
        masks.append(mask)
    return Photographs(cameras, brightness, masks)


def closest_curl(
    axes: Float[Tensor, "strand point 3"],
    normals: Float[Tensor, "strand 3"],
    seen: Photographs,
    turn: int,
    config: CurlConfig,
) -> Curl | None:
    """The curl whose drawing has the texture closest to the photographs'; None if straight hair comes about as close.

    Args:
        axes: strands along the axes of the curls.
        normals: outward unit normals at their roots.
        seen: the photographs.
        turn: handedness of the curls.
        config: size of the locks that curl in phase.
    """
    every = max(1, math.ceil(len(axes) / MOST_STRANDS))
    axes, normals = axes[::every], normals[::every]
    phase = lock_phases(axes[:, 0], config.lock)
    courses = [course_of(axes, camera) for camera in seen.cameras]
    filters = OrientationConfig()
    wanted = texture_of(seen.brightness, seen.masks, courses, seen.cameras, filters)

    def apart(strands: Float[Tensor, "strand point 3"]) -> float:
        """Difference between drawn strands and the photographs."""
        random = torch.Generator().manual_seed(0)
        drawn = [drawn_hair(strands, camera, random) for camera in seen.cameras]
        return texture_of(drawn, seen.masks, courses, seen.cameras, filters).difference(wanted)

    tried: dict[Curl, float] = {}

    def difference(slope: float, pitch: float) -> float:
        curl = Curl(slope * pitch / (2 * math.pi), pitch, turn)
        if curl not in tried:
            tried[curl] = apart(curled(axes, normals, phase, curl))
        return tried[curl]

    # The lean depends on the slope and hardly on the pitch, so the two are searched in turn.
    slope = min(SLOPES, key=lambda slope: difference(slope, PITCHES[len(PITCHES) // 2]))
    pitch = min(PITCHES, key=lambda pitch: difference(slope, pitch))
    min(SLOPES, key=lambda slope: difference(slope, pitch))
    best = min(tried, key=lambda curl: tried[curl])
    return best if tried[best] < apart(axes) - LEAST_GAIN else None


def _is_strong(lean: Lean, config: CurlConfig) -> bool:
    """Whether segments lean enough, and enough alike, to be those of curls."""
    return abs(math.degrees(lean.angle)) >= config.least_lean and lean.agreement >= config.least_agreement
