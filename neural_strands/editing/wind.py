"""Quick wind: segments of strands turn towards the wind by small angles (paper, "Applications: Animation").

A hair in steady wind hangs along the sum of its weight and the wind's force, so a direction m turns towards m + tau w,
where w is the wind's and tau the force over the weight. Here tau grows from zero at the root, where hair is stiff, and
varies with gusts: waves that travel with the wind and, with a delay, down the strands. Motion is therefore similar for
nearby strands and times. All segments of a strand rotate about one axis, so that curls keep their shape and lengths are
preserved. Strands are kept out of the head; points that a fit left inside it come out within a second.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.gusts import WindField
from neural_strands.editing.haircut import arc_lengths
from neural_strands.editing.outside import clearance_at, follow_outside, rest_clearance
from neural_strands.editing.settings import Wind
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.resample import interpolate_evenly
from neural_strands.geometry.strands import Strands, segments

STIFF = 0.12
"""Arc length from the root over which hair yields to the wind, metres."""
DOWN = 0.5
"""Speed at which a gust travels down a strand, metres per second."""
KNOTS = 9
"""Number of places along a strand at which gusts are computed; in between they are interpolated."""


class BlownHair:
    """Hair in the wind at any time; everything that is constant over time is computed once."""

    def __init__(self, wind: Wind, strands: Strands, body: SignedDistanceGrid | None) -> None:
        """Prepare for strands at rest.

        Args:
            wind: what blows.
            strands: at rest.
            body: what strands must not enter, if anything.
        """
        points = strands.points
        self.wind, self.body, self.roots = wind, body, points[:, 0]
        self.field = WindField(wind, points.device)
        self.steps = segments(points)
        self.mean = torch.nn.functional.normalize(points[:, -1] - points[:, 0], dim=1)
        arc = arc_lengths(points)[:, :-1]
        self.give = 1 - torch.exp(-((arc / STIFF) ** 2))
        self.arc = arc
        self.clearance = rest_clearance(points, body)

    @torch.no_grad()
    def at(self, seconds: float) -> Float[Tensor, "strand point 3"]:
        """Points at a moment, counted from when the wind begins to rise."""
        knots = torch.linspace(0, 1, KNOTS, device=self.roots.device)
        moments = seconds - self.arc[:, -1:] * knots / DOWN
        gust, swerve = self.field.gust_and_swerve(self.roots, moments)
        force = self.field.force(seconds) * interpolate_evenly(gust, self.steps.shape[1]) * self.give
        steps = turned(self.steps, self.mean, self.field.towards(swerve.mean(dim=1, keepdim=True)), force)
        return follow_outside(self.roots, steps, self.body, clearance_at(self.clearance, seconds))


def turned(
    steps: Float[Tensor, "strand segment 3"],
    mean: Float[Tensor, "strand 3"],
    towards: Float[Tensor, "strand 3"],
    force: Float[Tensor, "strand segment"],
) -> Float[Tensor, "strand segment 3"]:
    """Rotate segments by the angle between m and m + tau w, about the axis m x w; lengths are preserved.

    Args:
        steps: segments of the strands.
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
