"""Quick wind: segments of strands turn towards the wind by small angles (paper, "Applications: Animation").

A hair in steady wind hangs along the sum of its weight and the wind's force, so a direction m turns towards
m + tau w, where w is the wind's and tau the force over the weight. Here tau grows from nothing at the root, where hair
is stiff, and varies with gusts: waves that travel with the wind and, later and later, down the strands. Nearby strands
and moments therefore move alike. All segments of a strand turn about one axis, so that curls keep their shape, and
lengths stay as they are. Strands are kept out of the head.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.haircut import arc_lengths
from neural_strands.editing.outside import follow_outside, rest_clearance
from neural_strands.editing.settings import Wind
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.strands import Strands, segments

STIFF = 0.12
"""Arc length from the root over which hair gives in to the wind, metres."""
RISE = 0.5
"""Seconds in which the wind rises."""
SPEED = 0.8
"""Speed at which gusts cross the hair, metres per second."""
DOWN = 0.5
"""Speed at which a gust runs down a strand, metres per second."""
LONGEST_WAVE, SHORTEST_WAVE = 0.5, 0.06
"""Size of gusts, metres."""
WAVES = 6
"""Number of waves that make up the gusts, and as many the swerves."""
SWERVE = 0.25
"""Sideways force over the force along the wind, where gusts are strongest."""
KNOTS = 9
"""Places along a strand at which gusts are computed; between them they are blended."""


@dataclass(frozen=True)
class Gusts:
    """Waves that travel with the wind.

    Attributes:
        waves: wave vectors, radians per metre.
        speed: angular velocities, radians per second.
        phase: radians.
        size: amplitudes; their squares add up to one half.
    """

    waves: Float[Tensor, "wave 3"]
    speed: Float[Tensor, " wave"]
    phase: Float[Tensor, " wave"]
    size: Float[Tensor, " wave"]

    @classmethod
    def drawn(cls, wind: Float[Tensor, "3"], random: torch.Generator) -> "Gusts":
        """Random waves, most of them along the wind, slow large ones stronger than quick small ones."""
        share = torch.linspace(0, 1, WAVES)
        length = LONGEST_WAVE * (SHORTEST_WAVE / LONGEST_WAVE) ** share
        heading = wind.cpu() + 0.5 * torch.randn(WAVES, 3, generator=random)
        waves = torch.nn.functional.normalize(heading, dim=1) * (2 * math.pi / length)[:, None]
        size = length**0.5
        phase = 2 * math.pi * torch.rand(WAVES, generator=random)
        parts = (waves, SPEED * (waves @ wind.cpu()), phase, size / size.norm())
        return cls(*(part.to(wind) for part in parts))

    def at(
        self, places: Float[Tensor, "place 3"], seconds: Float[Tensor, "place moment"]
    ) -> Float[Tensor, "place moment"]:
        """Strength of the gusts at places and moments, about between -1 and 1."""
        angle = (places @ self.waves.T + self.phase)[:, None] - seconds[..., None] * self.speed
        return angle.sin() @ self.size


class BlownHair:
    """Hair in the wind at any moment; what does not change over time is computed once."""

    def __init__(self, wind: Wind, strands: Strands, body: SignedDistanceGrid | None) -> None:
        """Prepare for strands at rest.

        Args:
            wind: what blows.
            strands: at rest.
            body: what strands must not enter, if anything.
        """
        points = strands.points
        random = torch.Generator().manual_seed(wind.seed)
        self.wind, self.body, self.roots = wind, body, points[:, 0]
        self.direction = torch.nn.functional.normalize(points.new_tensor(wind.direction), dim=0)
        self.gusts, self.swerves = (Gusts.drawn(self.direction, random) for _ in range(2))
        self.steps = segments(points)
        self.mean = torch.nn.functional.normalize(points[:, -1] - points[:, 0], dim=1)
        arc = arc_lengths(points)[:, :-1]
        self.give = 1 - torch.exp(-((arc / STIFF) ** 2))
        self.arc = arc
        self.clearance = None if body is None else rest_clearance(points, body)
        side = torch.linalg.cross(self.direction, self.direction.roll(1) + 0.1)
        self.side = torch.nn.functional.normalize(side, dim=0)

    @torch.no_grad()
    def at(self, seconds: float) -> Float[Tensor, "strand point 3"]:
        """Points at a moment, counted from when the wind begins to rise."""
        rising = min(max(seconds / RISE, 0.0), 1.0)
        force = self.wind.strength * rising * rising * (3 - 2 * rising)
        knots = torch.linspace(0, 1, KNOTS, device=self.roots.device)
        moments = seconds - self.arc[:, -1:] * knots / DOWN
        gust = (1 + self.wind.gusts * self.gusts.at(self.roots, moments)).clamp(min=0.0)
        swerve = SWERVE * self.wind.gusts * self.swerves.at(self.roots, moments).mean(dim=1)
        towards = torch.nn.functional.normalize(self.direction + swerve[:, None] * self.side, dim=1)
        steps = turned(self.steps, self.mean, towards, force * self._between_knots(gust) * self.give)
        if self.body is None or self.clearance is None:
            return torch.cat([self.roots[:, None], self.roots[:, None] + steps.cumsum(dim=1)], dim=1)
        return follow_outside(self.roots, steps, self.body, self.clearance)

    def _between_knots(self, values: Float[Tensor, "strand knot"]) -> Float[Tensor, "strand segment"]:
        """Values at every segment of those at knots evenly spaced along the strand."""
        place = torch.linspace(0, KNOTS - 1, self.steps.shape[1], device=values.device)
        before = place.long().clamp(max=KNOTS - 2)
        return torch.lerp(values[:, before], values[:, before + 1], place - before)


def turned(
    steps: Float[Tensor, "strand segment 3"],
    mean: Float[Tensor, "strand 3"],
    towards: Float[Tensor, "strand 3"],
    force: Float[Tensor, "strand segment"],
) -> Float[Tensor, "strand segment 3"]:
    """Turn segments by the angle by which m + tau w lies away from m, about the axis m x w; lengths are kept.

    Args:
        steps: segments.
        mean: unit direction m of each strand as a whole.
        towards: unit direction w of the wind at each strand.
        force: tau of each segment.
    """
    cosine = (mean * towards).sum(dim=1, keepdim=True)
    across = torch.linalg.cross(mean, towards, dim=1)
    sine = across.norm(dim=1, keepdim=True)
    axis = (across / sine.clamp(min=1e-9))[:, None]
    # Rodrigues' formula, with cosine and sine of the angle of (1 + tau cos, tau sin).
    along, sideways = 1 + force * cosine, force * sine
    size = torch.hypot(along, sideways).clamp(min=1e-9)
    turn_cosine, turn_sine = (along / size)[..., None], (sideways / size)[..., None]
    on_axis = (steps * axis).sum(dim=-1, keepdim=True)
    across_axis = torch.linalg.cross(axis.expand_as(steps), steps, dim=-1)
    return steps * turn_cosine + across_axis * turn_sine + axis * (on_axis * (1 - turn_cosine))
