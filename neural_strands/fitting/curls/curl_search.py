"""Find out whether hair is curly, and how large its curls are, by drawing it (analysis by synthesis).

Segments that all lean to one side of the hair's hanging course are the first sign of curls that turn alike. Turned
back, they show the course of the curls' axes. Strands along it are then wound with many radii and pitches, drawn, and
compared with the photographs by their texture. The hair is curly unless strands that follow the segments as they are
look clearly more like the photographs. Where segments lean less, curls have to look more like the photographs than
waves and than strands that follow the segments.

Hair whose segments do not lean may be wavy, or its locks may turn either way: leans to both sides cancel out, and
strands that follow the segments are the axes. Then the streaks of photographs lean off these strands, drawn as they
are, far more than the streaks of straight hair.
"""

import math
from dataclasses import dataclass, replace

from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.fitting.curls.comparison import (
    FOR_CURLINESS,
    FOR_SIZE,
    MOST_STRANDS,
    Comparison,
    DrawnCurl,
    closest_curl,
    photographs,
)
from neural_strands.fitting.curls.helices import Helices, closest_helices, leaning_segments
from neural_strands.fitting.curls.streaks import Texture
from neural_strands.flow.curls import Curl, CurlConfig, Locks, curled
from neural_strands.flow.field import FlowField
from neural_strands.flow.hair_flow import HairRoom, InitialConfig, hair_flow
from neural_strands.flow.tracing import TracedStrands, trace_hair
from neural_strands.foundation.progress import Track, untracked
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.resample import resample_strands
from neural_strands.geometry.views import Views

ALIKE = 0.15
"""Textures that differ by less than this are alike."""
WAVY = 0.25
"""Hair may be wavy if more of its streaks than this lean otherwise than those of strands along the segments."""
FOR_WAVES = 12
"""Largest number of views in which this is measured: the share differs from view to view."""
OF_NOISE = 0.5
"""If strands along the segments, drawn in as much noise as the photographs have, leave less than this share of the
difference, noise explains most of it, and not waves."""
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


def find_curls(
    room: HairRoom,
    segments: LineSegments,
    views: Views,
    plain: Float[Tensor, "root point 3"],
    scalp_normals: Float[Tensor, "root 3"],
    scalp_faces: Int64[Tensor, " scalp"],
    config: InitialConfig,
    track: Track = untracked,
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
        track: shows the progress of the flow along the axes, and of the search.
    """
    if not config.curls.find or not room.masked:
        return None
    every = max(1, math.ceil(len(plain) / MOST_STRANDS))
    straight, normals = Comparison.along(plain[::every], photographs(views)), scalp_normals[::every]
    roots = plain[:, 0]
    scalp, leaving = (roots, scalp_normals, scalp_faces), _leaving(config, config.curls.way_out)
    leaning = leaning_segments(room, segments, roots, scalp_normals, config, track)
    if leaning is not None and leaning.strong:
        helices = closest_helices(room, leaning, scalp, straight, normals, leaving, track)
        if _look_curly(helices, straight):
            return FoundCurls(helices.drawn.curl, helices.axes)
    drawn = straight.of(straight.axes)
    waves = _find_waves(straight, drawn, normals, config.curls, track) if _may_be_wavy(straight.axes, views) else None
    if leaning is not None and not leaning.strong:
        helices = closest_helices(room, leaning, scalp, straight, normals, leaving, track)
        rival = drawn if waves is None else waves.texture
        if helices.drawn.difference(FOR_SIZE) < rival.difference(straight.seen, FOR_SIZE):
            return FoundCurls(helices.drawn.curl, helices.axes)
    if waves is None:
        return None
    flow = hair_flow(room, segments, roots, scalp_normals, _leaving(config, config.curls.waves_way_out), track)
    return FoundCurls(waves.curl, flow)


def _look_curly(helices: Helices, straight: Comparison) -> bool:
    """Whether hair with helices is as much like the photographs as strands that follow the segments as they are."""
    seen = helices.comparison.seen
    plainly = helices.comparison.of(straight.axes).difference(seen, FOR_CURLINESS)
    return helices.drawn.difference(FOR_CURLINESS) <= plainly + (MOST_WORSE if plainly > ALIKE else 0.0)


def _may_be_wavy(axes: Float[Tensor, "strand point 3"], views: Views) -> bool:
    """Whether many of the photographs' streaks lean off the strands that follow the segments."""
    many = Comparison.along(axes, photographs(views, FOR_WAVES))
    return many.of(axes).lean_difference(many.seen) >= WAVY


def _find_waves(
    comparison: Comparison, straight: Texture, normals: Float[Tensor, "strand 3"], config: CurlConfig, track: Track
) -> DrawnCurl | None:
    """Look for waves about the strands that follow the segments, of texture `straight` if drawn as they are."""
    seen = comparison.seen
    plainly = straight.lean_difference(seen)
    noise = comparison.noise()
    if noise > 0 and comparison.of(comparison.axes, noise).lean_difference(seen) < OF_NOISE * plainly:
        # Noise turns streaks to either side, as waves do.
        return None
    drawn = closest_curl(comparison, normals, 0, config, track=track)
    if drawn.texture.repetition_difference(seen) > straight.repetition_difference(seen):
        # What repeats in these photographs is not the waves.
        drawn = closest_curl(comparison, normals, 0, config, (USUAL_PITCH,), track)
    return drawn if drawn.texture.lean_difference(seen) < CLEARLY * plainly else None


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


def _leaving(config: InitialConfig, way_out: float) -> InitialConfig:
    """Settings with another `ConservationConfig.way_out`."""
    return replace(config, conservation=replace(config.conservation, way_out=way_out))
