"""Curly hair: how far segments lean off the hair's course, and strands that wind about that course.

Tangents of a helix of radius r and pitch p make the angle atan(2 pi r / p) with its axis. Cameras see the outer half
of each turn, where all curls that turn alike lean to the same side. So segments on curls mislead the flow, but they
lean by nearly the same angle everywhere: turned back by that angle, they show the course of the axes.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.field import FlowField
from neural_strands.flow.surface import surface_normals
from neural_strands.foundation.configs import Between
from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.frames import strand_frames
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.point_queries import assign_locks
from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.geometry.strands import lengths_along

POINTS_PER_TURN = 12
"""Points of a strand for each of its turns."""


@dataclass(frozen=True)
class Curl:
    """A helix about the course of a strand.

    Attributes:
        radius: distance from the axis, metres.
        pitch: length of a turn along the axis, metres.
        turn: 1 if right-handed, -1 if left-handed, 0 if some locks turn one way and some the other.
        roundness: radius away from the scalp as a share of that sideways: 1 for a helix, less for waves.
    """

    radius: float
    pitch: float
    turn: int
    roundness: float = 1.0

    @property
    def slope(self) -> float:
        """Tangent of the angle between the curl and its axis."""
        return 2 * math.pi * self.radius / self.pitch


@dataclass(frozen=True)
class CurlConfig:
    """When hair counts as curly, and how curls are laid about their axes."""

    find: bool = True
    """Whether to look for curls in the photographs."""
    least_lean: Annotated[float, Between(0, 90)] = 25.0
    """Hair is tested for curls if its segments lean by this angle or more, degrees."""
    least_agreement: Annotated[float, Between(0, 1)] = 0.5
    """Smallest length of the mean of the segments' doubled directions: 0 if they lean anyhow, 1 if all lean alike."""
    suspected_lean: Annotated[float, Between(0, 90)] = 17.0
    """Hair is also tested if its segments lean by this angle or more, degrees. Then curls must look more like the
    photographs than waves, or than straight strands if there are no waves."""
    suspected_agreement: Annotated[float, Between(0, 1)] = 0.3
    """Smallest agreement of such segments where the surface of the hair is steep."""
    way_out: Annotated[float, Between(-1, 1)] = 0.9
    """`ConservationConfig.way_out` for axes of curls, which rarely end at the side of the hair."""
    waves_way_out: Annotated[float, Between(-1, 1)] = 0.3
    """The same for axes of waves."""
    lock: Annotated[float, Between(1e-4, 1)] = 0.014
    """Distance on the scalp between locks of hair that curl in phase, metres."""


@dataclass(frozen=True)
class Locks:
    """How each strand's lock curls; locks are independent of each other.

    Attributes:
        phase: angle at which the strand starts, radians.
        turn: 1 or -1, the handedness where locks of one head differ in it.
    """

    phase: Float[Tensor, " strand"]
    turn: Float[Tensor, " strand"]

    @classmethod
    def drawn(cls, roots: Float[Tensor, "strand 3"], spacing: float) -> "Locks":
        """Draw a phase and a handedness for each lock: roots with the same nearest centre.

        Args:
            roots: positions on the scalp, metres.
            spacing: distance between the centres of locks, metres.
        """
        random = torch.Generator().manual_seed(0)
        lock = assign_locks(roots.cpu(), spacing, random)
        phase = (2 * math.pi * torch.rand(len(roots), generator=random))[lock]
        turn = torch.where(torch.rand(len(roots), generator=random) < 0.5, -1.0, 1.0)[lock]
        return cls(phase.to(roots), turn.to(roots))


@dataclass(frozen=True)
class Lean:
    """How segments lean off the course of the hair, seen from outside.

    Attributes:
        angle: mean lean, counter-clockwise, radians in (-pi / 2, pi / 2].
        agreement: length of the mean of the doubled directions, from 0 to 1.
    """

    angle: float
    agreement: float


def mean_lean(
    directions: Float[Tensor, "point 3"],
    axes: Float[Tensor, "point 3"],
    normals: Float[Tensor, "point 3"],
) -> Lean:
    """Mean angle between unsigned directions and the axes, in the plane across the normal.

    Args:
        directions: unit tangents, with any sign.
        axes: unit directions of the hair's course there.
        normals: unit normals of the hair's surface, towards the viewer.
    """
    course, across = _in_surface(axes, normals), _in_surface(directions, normals)
    sine = (torch.linalg.cross(course, across) * normals).sum(dim=-1)
    angle = 2 * torch.atan2(sine, (course * across).sum(dim=-1))
    mean = torch.stack([angle.cos(), angle.sin()]).mean(dim=1) if len(angle) else torch.zeros(2)
    return Lean(0.5 * math.atan2(float(mean[1]), float(mean[0])), float(mean.norm()))


def turned_back(segments: LineSegments, field: FlowField, lean: float) -> LineSegments:
    """Rotate the directions of segments by `-lean` about the surface of the hair; the field gives their sign.

    Args:
        segments: segments on curls.
        field: course of the hair, roughly.
        lean: angle by which segments lean off it, radians.
    """
    normals, given = surface_normals(field.grid, field.domain, segments.points), segments.directions
    along = (given * normals).sum(dim=-1, keepdim=True) * normals
    turned = along + math.cos(lean) * (given - along) - math.sin(lean) * torch.linalg.cross(normals, given)
    course = field.at(segments.points)
    sign = torch.where((turned * course).sum(dim=-1, keepdim=True) < 0, -1.0, 1.0)
    return replace(segments, directions=functional.normalize(sign * turned, dim=-1))


def curled(
    axes: Float[Tensor, "strand point 3"],
    normals: Float[Tensor, "strand 3"],
    locks: Locks,
    curl: Curl,
    distance: SignedDistanceGrid | None = None,
) -> Float[Tensor, "strand dense 3"]:
    """Wind strands about their axes; a curl grows to its full radius over its first turn.

    Args:
        axes: polylines, root first.
        normals: outward unit normals at the roots.
        locks: in which phase each strand curls, and to which side if the curl itself turns to none.
        curl: radius, pitch, handedness and roundness.
        distance: signed distance to the head; strands are lifted off it by as much as their curls would enter it.
    """
    longest = float(lengths_along(axes)[:, -1].max())
    count = max(axes.shape[1], math.ceil(POINTS_PER_TURN * longest / curl.pitch) + 1)
    dense = resample_polyline_lengths(axes, count)
    turns = lengths_along(dense) / curl.pitch
    radius = curl.radius * smoothstep(turns)
    turn = locks.turn[:, None] if curl.turn == 0 else curl.turn
    points = wound(dense, normals, radius, locks.phase[:, None] + turn * 2 * math.pi * turns, curl.roundness)
    if distance is None:
        return points
    height, outward = distance.with_outward(dense)
    return points + (radius - height.clamp(min=0)).clamp(min=0)[..., None] * outward


def wound(
    axes: Float[Tensor, "strand point 3"],
    normals: Float[Tensor, "strand 3"],
    radius: Float[Tensor, "strand point"],
    angle: Float[Tensor, "strand point"],
    roundness: float = 1.0,
) -> Float[Tensor, "strand point 3"]:
    """Wind curves about axes: a right-handed helix where the angle grows along the axis, left-handed where it falls.

    Args:
        axes: polylines, with ten points or more for each turn.
        normals: unit normals of the scalp at the roots; the angle is measured from the direction across both the
            normal and the axis.
        radius: distance from the axis, metres.
        angle: angle about the axis, radians.
        roundness: distance away from the scalp as a share of that sideways: 0 gives a flat wave, 1 a helix.
    """
    offset = torch.stack([radius * angle.cos(), roundness * radius * angle.sin()], dim=-1)
    return axes + (strand_frames(axes, normals)[..., :2] @ offset[..., None]).squeeze(-1)


def _in_surface(vectors: Float[Tensor, "point 3"], normals: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
    """The unit part of vectors across the normals."""
    return functional.normalize(vectors - (vectors * normals).sum(dim=-1, keepdim=True) * normals, dim=-1)
