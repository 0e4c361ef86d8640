"""Find out whether hair is curly, and how large its curls are, by drawing it (analysis by synthesis).

Segments that all lean to one side of the hair's hanging course are the first sign of curls that turn alike. Turned
back, they show the course of the curls' axes. Strands along it are then wound with many radii and pitches, drawn, and
compared with the photographs by their texture. The hair is curly unless strands that follow the segments as they are
look clearly more like the photographs.

Hair whose segments do not lean may be wavy, or its locks may turn either way: leans to both sides cancel out, and
strands that follow the segments are the axes. Then the streaks of photographs lean off these strands, drawn as they
are, far more than the streaks of straight hair.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn import functional

from neural_strands.fitting.curls.streaks import Course, Texture, course_of, drawn_hair, texture_of
from neural_strands.flow.curls import (
    Curl,
    CurlConfig,
    Lean,
    Locks,
    curled,
    mean_lean,
    turned_back,
)
from neural_strands.flow.field import FlowField
from neural_strands.flow.hair_flow import HairRoom, InitialConfig, hair_flow, hanging_flow
from neural_strands.flow.surface import surface_normals
from neural_strands.flow.tracing import TracedStrands, trace_hair
from neural_strands.flow.unseen import DOWN
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.resample import resample_strands
from neural_strands.geometry.views import Views
from neural_strands.lmvs.growth import GrowthConfig, orient_segments
from neural_strands.lmvs.orientation import OrientationConfig, luma

MOST_STRANDS = 5000
"""Largest number of strands that are drawn."""
MOST_VIEWS = 4
"""Largest number of views that drawn hair is compared with."""
LARGEST_SIDE = 512
"""Photographs are reduced to this size for the comparison, pixels."""
SLOPES = (0.4, 0.55, 0.7, 0.9, 1.12, 1.4, 1.75)
"""Slopes of curls that are tried: 2 pi radius / pitch."""
PITCHES = (0.012, 0.0155, 0.02, 0.024, 0.028, 0.034, 0.04, 0.05)
"""Lengths of a turn that are tried, metres; longer ones would not repeat within the lags that are compared."""
FIRST_INSET = 0.004
"""Depth of the axes below the surface of the hair while the radius is unknown, metres."""
LEVEL = 0.8
"""Places where the surface of the hair is more level than this (vertical part of its normal) do not show gravity."""
FOR_SIZE, FOR_CURLINESS = 1.0, 0.25
"""Weight of the repetition of textures against their lean: for the size of curls, and for whether there are any. Curls
of several sizes may have the same lean, but noise hides how they repeat."""
ALIKE = 0.15
"""Textures that differ by less than this are alike."""
WAVY = 0.25
"""Hair may be wavy if more of its streaks than this lean otherwise than those of strands along the segments."""
WAVE_ROUNDNESS = 0.5
"""Roundness of waves."""
USUAL_PITCH = 0.034
"""Length of a wave where the photographs do not tell it, metres."""
CLEARLY = 0.6
"""Waves must reduce the share of such streaks to this factor at most."""
MOST_WORSE = 0.1
"""By how much the texture of curls may differ more from the photographs than that of strands along the segments, if
neither is alike: noise hides curls, and hair that leans to one side all around the head is nearly always curly."""


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
class Comparison:
    """Drawn hair beside photographs.

    Attributes:
        photographs: the photographs.
        axes: strands that follow the course of the hair.
        courses: that course in each photograph.
        seen: texture of the photographs.
    """

    photographs: "Photographs"
    axes: Float[Tensor, "strand point 3"]
    courses: Sequence[Course]
    seen: Texture

    @classmethod
    def along(cls, axes: Float[Tensor, "strand point 3"], photographs: "Photographs") -> "Comparison":
        """Measure the texture of photographs relative to strands that follow the course of the hair."""
        courses = [course_of(axes, camera) for camera in photographs.cameras]
        return cls(photographs, axes, courses, _texture(photographs.brightness, photographs, courses))

    def of(self, strands: Float[Tensor, "strand point 3"]) -> Texture:
        """Texture of drawn strands relative to the same course."""
        random = torch.Generator().manual_seed(0)
        drawn = [drawn_hair(strands, camera, random) for camera in self.photographs.cameras]
        return _texture(drawn, self.photographs, self.courses)


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
    plain: Float[Tensor, "root point 3"],
    scalp_normals: Float[Tensor, "root 3"],
    scalp_faces: Int64[Tensor, " scalp"],
    config: InitialConfig,
) -> FoundCurls | None:
    """Look for curls that all turn alike, then for waves; None if there are neither, or if no view has a hair mask.

    Args:
        room: where hair can be.
        segments: line segments of the hair.
        views: the photographs.
        plain: strands traced along the segments as they are.
        scalp_normals: outward unit normals at their roots.
        scalp_faces: the faces of the head that hair grows from.
        config: settings of the initial strands.
    """
    if not config.curls.find or not room.masked:
        return None
    seen, every = photographs(views), max(1, math.ceil(len(plain) / MOST_STRANDS))
    drawn, normals = plain[::every], scalp_normals[::every]
    scalp = (plain[:, 0], scalp_normals)
    if helices := _find_helices(room, segments, seen, scalp, drawn, normals, scalp_faces, config):
        return helices
    curl = _find_waves(seen, drawn, normals, config.curls)
    if curl is None:
        return None
    return FoundCurls(curl, hair_flow(room, segments, *scalp, _leaving(config, config.curls.waves_way_out)))


def _find_waves(
    seen: "Photographs",
    plain: Float[Tensor, "strand point 3"],
    normals: Float[Tensor, "strand 3"],
    config: CurlConfig,
) -> Curl | None:
    """Look for waves about the strands that follow the segments as they are."""
    comparison = Comparison.along(plain, seen)
    straight = comparison.of(plain)
    plainly = straight.lean_difference(comparison.seen)
    if plainly < WAVY:
        return None
    curl, drawn = closest_curl(comparison, normals, 0, config)
    if drawn.repetition_difference(comparison.seen) > straight.repetition_difference(comparison.seen):
        # What repeats in these photographs is not the waves.
        curl, drawn = closest_curl(comparison, normals, 0, config, (USUAL_PITCH,))
    return curl if drawn.lean_difference(comparison.seen) < CLEARLY * plainly else None


def _find_helices(
    room: HairRoom,
    segments: LineSegments,
    seen: "Photographs",
    scalp: tuple[Float[Tensor, "root 3"], Float[Tensor, "root 3"]],
    plain: Float[Tensor, "strand point 3"],
    normals: Float[Tensor, "strand 3"],
    scalp_faces: Int64[Tensor, " face"],
    config: InitialConfig,
) -> FoundCurls | None:
    """Look for curls that all turn alike: `scalp` has all roots and normals, `plain` and `normals` those to draw."""
    kept = segments.select(segments.confidence >= config.flow.least_confidence)
    if not _is_strong(lean_off_gravity(room, kept), config.curls):
        return None
    course = hanging_flow(room, kept, *scalp, config)
    lean = lean_off(course, kept)
    if not _is_strong(lean, config.curls):
        return None
    # Neighbours sign turned segments better than the hanging course does, for instance at a parting.
    straight = orient_segments(turned_back(kept, course, lean.angle), room.head, scalp_faces, [], GrowthConfig())
    along = _leaving(config, config.curls.way_out)
    axes = hair_flow(room.inset(FIRST_INSET), straight, *scalp, along)
    traced = trace_hair(axes, plain[:, 0], normals, config.trace).points
    turn = -round(math.copysign(1, lean.angle))
    comparison = Comparison.along(traced, seen)
    curl, drawn = closest_curl(comparison, normals, turn, config.curls)
    difference = drawn.difference(comparison.seen, FOR_CURLINESS)
    plainly = comparison.of(plain).difference(comparison.seen, FOR_CURLINESS)
    if difference > plainly + (MOST_WORSE if plainly > ALIKE else 0.0):
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
    points = curled(axes.points, normals, Locks.drawn(roots, config.curls.lock), found.curl, distance)
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
    comparison: "Comparison",
    normals: Float[Tensor, "strand 3"],
    turn: int,
    config: CurlConfig,
    pitches: Sequence[float] = PITCHES,
) -> tuple[Curl, Texture]:
    """The curl whose drawing has the texture closest to the photographs', and that texture.

    Args:
        comparison: the photographs, and strands along the axes of the curls.
        normals: outward unit normals at the roots of those strands.
        turn: handedness of the curls; 0 for waves.
        config: size of the locks that curl in phase.
        pitches: lengths of a turn to try, metres.
    """
    locks = Locks.drawn(comparison.axes[:, 0], config.lock)
    tried: dict[tuple[float, float], Texture] = {}

    def size(slope: float, pitch: float) -> Curl:
        return Curl(slope * pitch / (2 * math.pi), pitch, turn, 1.0 if turn else WAVE_ROUNDNESS)

    def texture(slope: float, pitch: float) -> Texture:
        if (slope, pitch) not in tried:
            tried[slope, pitch] = comparison.of(curled(comparison.axes, normals, locks, size(slope, pitch)))
        return tried[slope, pitch]

    seen = comparison.seen
    # The lean depends on the slope and hardly on the pitch, so the two can be searched in turn.
    slope = min(SLOPES, key=lambda slope: texture(slope, pitches[len(pitches) // 2]).lean_difference(seen))
    pitch = min(pitches, key=lambda pitch: texture(slope, pitch).difference(seen, FOR_SIZE))
    slope = min(SLOPES, key=lambda slope: texture(slope, pitch).difference(seen, FOR_SIZE))
    return size(slope, pitch), texture(slope, pitch)


def _leaving(config: InitialConfig, way_out: float) -> InitialConfig:
    """Settings with another `ConservationConfig.way_out`."""
    return replace(config, conservation=replace(config.conservation, way_out=way_out))


def _is_strong(lean: Lean, config: CurlConfig) -> bool:
    """Whether segments lean enough, and enough alike, to be those of curls."""
    return abs(math.degrees(lean.angle)) >= config.least_lean and lean.agreement >= config.least_agreement


def _texture(
    pictures: Sequence[Float[Tensor, "height width"]], seen: Photographs, courses: Sequence[Course]
) -> Texture:
    """Texture of pictures from the cameras of the photographs."""
    return texture_of(pictures, seen.masks, courses, seen.cameras, OrientationConfig())
