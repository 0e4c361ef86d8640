"""Helices: curls that all turn alike, found by the side to which segments lean.

Segments on such curls lean off the course of the hair to one side. Turned back, they show the course of the axes.
By how much they lean is known only as well as that course: hair that is combed to one side does not hang, and segments
may lean off a hanging course by too little. Where they hardly agree, larger leans are therefore tried as well.
"""

import math
from dataclasses import dataclass, replace

from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn import functional

from neural_strands.fitting.curls.comparison import FOR_SIZE, Comparison, DrawnCurl, closest_curl
from neural_strands.flow.curls import Lean, mean_lean, turned_back
from neural_strands.flow.field import FlowField
from neural_strands.flow.hair_flow import HairRoom, InitialConfig, hair_flow, hanging_flow
from neural_strands.flow.surface import surface_normals
from neural_strands.flow.tracing import trace_hair
from neural_strands.flow.unseen import DOWN
from neural_strands.foundation.progress import Track, untracked
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.growth import GrowthConfig, orient_segments

FIRST_INSET = 0.004
"""Depth of the axes below the surface of the hair while the radius is unknown, metres."""
LEVEL = 0.8
"""Places where the surface of the hair is more level than this (vertical part of its normal) do not show gravity."""
FURTHER = (0.0, 15.0, 30.0)
"""By how much more than measured segments that hardly agree are turned back, degrees."""
MOST_LEAN = 60.0
"""Such segments are not turned back further than this, degrees."""
OFF_COURSE, OFF_AXES = 35.0, 25.0
"""Segments that are turned back mislead if they are further than this off the hanging course, or off the axes that the
rest show, degrees."""
ANY = 180.0
"""Limit of those angles where the hanging course may be wrong."""


@dataclass(frozen=True)
class Leaning:
    """Segments that lean off the hanging course of the hair.

    Attributes:
        segments: the segments.
        course: that course.
        lean: by how much they lean.
        strong: whether they lean enough, and enough alike, to be those of helices. Otherwise they may be those of
            waves.
    """

    segments: LineSegments
    course: FlowField
    lean: Lean
    strong: bool

    @property
    def turn(self) -> int:
        """Handedness of the helices on which segments lean like this."""
        return -round(math.copysign(1, self.lean.angle))

    def tried(self, least_agreement: float) -> list[float]:
        """Angles by which the segments may lean off the axes of the helices, radians.

        Args:
            least_agreement: agreement of segments off a course that is about right.
        """
        if self.lean.agreement >= least_agreement:
            # Further leans would look as much like the photographs, with larger curls.
            return [self.lean.angle]
        lean = abs(self.lean.angle)
        further = [lean + math.radians(each) for each in FURTHER]
        return [math.copysign(each, self.lean.angle) for each in further if each <= math.radians(MOST_LEAN)]


@dataclass(frozen=True)
class Helices:
    """Helices about the axes that leaning segments show.

    Attributes:
        drawn: the helix whose drawing is closest to the photographs.
        axes: the flow along the axes.
        comparison: the photographs beside strands along the axes.
        lean: angle by which segments lean off the axes, radians.
    """

    drawn: DrawnCurl
    axes: FlowField
    comparison: Comparison
    lean: float


def leaning_segments(
    room: HairRoom,
    segments: LineSegments,
    roots: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    config: InitialConfig,
    track: Track = untracked,
) -> Leaning | None:
    """The segments that show how hair leans; None if they hardly lean, as those of most hair.

    Args:
        room: where hair can be.
        segments: line segments of the hair.
        roots: where strands start, metres.
        scalp_normals: outward unit normals there.
        config: settings of the initial strands.
        track: shows the progress of the hanging flow.
    """
    kept, curls = segments.select(segments.confidence >= config.flow.least_confidence), config.curls
    steep = lean_off_gravity(room, kept)
    if not _leans(steep, curls.suspected_lean, curls.suspected_agreement):
        return None
    course = hanging_flow(room, kept, roots, scalp_normals, config, track)
    lean = lean_off(course, kept)
    # Where hair does not hang, segments agree less about that course than where its surface is steep.
    if not _leans(lean, curls.suspected_lean, 0.0):
        return None
    strong = all(_leans(each, curls.least_lean, curls.least_agreement) for each in (steep, lean))
    return Leaning(kept, course, lean, strong)


def closest_helices(
    room: HairRoom,
    leaning: Leaning,
    scalp: tuple[Float[Tensor, "root 3"], Float[Tensor, "root 3"], Int64[Tensor, " face"]],
    plain: Comparison,
    normals: Float[Tensor, "strand 3"],
    config: InitialConfig,
    track: Track = untracked,
) -> Helices:
    """The helices whose drawing is closest to the photographs, of all leans that are tried.

    Some segments, most of them at tips and over the forehead, lean otherwise, and a few lead many strands astray. So
    turned segments far off the hair's course are left out. Then all are turned again, relative to the axes that the
    rest show, and those far off these axes are left out.

    Args:
        room: where hair can be.
        leaning: segments that lean.
        scalp: roots, their normals, and the faces of the head that hair grows from.
        plain: the photographs beside the strands to draw, as they are along the segments.
        normals: outward unit normals at the roots of those strands.
        config: settings of the initial strands, `way_out` as for helices.
        track: shows the progress of the flow along the axes, and of the search.
    """
    roots, scalp_normals, faces = scalp

    def flow(straight: LineSegments, depth: float) -> FlowField:
        return hair_flow(room.inset(depth), straight, roots, scalp_normals, config, track)

    def straightened(course: FlowField, lean: float, limit: float) -> LineSegments:
        turned = turned_back(leaning.segments, course, lean)
        # Neighbours sign turned segments better than the hanging course does, for instance at a parting.
        return along_course(orient_segments(turned, room.head, faces, [], GrowthConfig()), course, limit)

    def drawn(axes: FlowField, lean: float) -> Helices:
        traced = trace_hair(axes, plain.axes[:, 0], normals, config.trace).points
        comparison = Comparison.along(traced, plain.photographs)
        curl = closest_curl(comparison, normals, leaning.turn, config.curls, track=track)
        return Helices(curl, axes, comparison, lean)

    limit, leans = OFF_COURSE if leaning.strong else ANY, leaning.tried(config.curls.least_agreement)
    found = [drawn(flow(straightened(leaning.course, lean, limit), FIRST_INSET), lean) for lean in leans]
    closest = min(found, key=lambda helices: helices.drawn.difference(FOR_SIZE))
    better = straightened(closest.axes, closest.lean, OFF_AXES)
    return replace(closest, axes=flow(better, closest.drawn.curl.radius))


def along_course(segments: LineSegments, course: FlowField, limit: float) -> LineSegments:
    """The segments whose directions are off the course of the hair by less than `limit` degrees."""
    cosine = functional.cosine_similarity(segments.directions, course.at(segments.points), dim=-1)
    return segments.select(cosine > math.cos(math.radians(limit)))


def lean_off(course: FlowField, segments: LineSegments) -> Lean:
    """How segments lean off the course of the hair."""
    axes = course.at(segments.points)
    return mean_lean(segments.directions, axes, surface_normals(course.grid, course.domain, segments.points))


def lean_off_gravity(room: HairRoom, segments: LineSegments) -> Lean:
    """How segments lean off the vertical where the surface of the hair is steep; quick, because it needs no flow."""
    normals = surface_normals(room.grid, room.domain, segments.points)
    steep = normals[:, 1].abs() < LEVEL
    down = normals.new_tensor(DOWN).expand(int(steep.sum()), 3)
    return mean_lean(segments.directions[steep], down, normals[steep])


def _leans(lean: Lean, angle: float, agreement: float) -> bool:
    """Whether segments lean by an angle of some degrees or more, and alike enough."""
    return abs(math.degrees(lean.angle)) >= angle and lean.agreement >= agreement
