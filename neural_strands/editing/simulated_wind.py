"""Simulated wind: guides are elastic rods that the wind pushes (`editing.rods`), and the other strands follow them.

The air pushes a rod with tau times its weight, as in the quick wind, and damps it. Guides keep their lengths and stay
outside the body. The strands that follow them rotate with them, keep their own lengths exactly, and are bent around the
body where they would enter it. Hair does not collide with hair.

Time is divided into equal steps from the start. A state is always that after a whole number of steps, so it does not
depend on which times were requested before.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.gusts import WindField
from neural_strands.editing.outside import clearance_at, follow_outside, rest_clearance
from neural_strands.editing.rods.follow import Followers
from neural_strands.editing.rods.rods import GRAVITY, RodConfig, Rods
from neural_strands.editing.rods.step import RodState, advance, segment_turns
from neural_strands.editing.settings import Wind
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.geometry.strands import Strands

NODES = 40
"""Number of points along a guide."""
STEPS_A_SECOND = 240
"""Least number of time steps per second."""


class SimulatedHair:
    """Hair in simulated wind at any time."""

    def __init__(self, wind: Wind, strands: Strands, body: SignedDistanceGrid | None) -> None:
        """Prepare for strands at rest.

        Args:
            wind: settings of the wind.
            strands: the strands at rest.
            body: signed distance to what strands must not enter, if anything.
        """
        points = strands.points
        self.wind, self.body, self.roots = wind, body, points[:, 0]
        self.field = WindField(wind, points.device)
        self.followers = Followers.of(points, wind.guides, NODES)
        # A frame is a whole number of steps.
        self.seconds_a_step = 1 / (wind.fps * math.ceil(STEPS_A_SECOND / wind.fps))
        guides = resample_polyline_lengths(points[self.followers.chosen], NODES)
        self.rods = Rods.at_rest(guides, RodConfig(), self.seconds_a_step)
        self.guide_clearance, self.clearance = rest_clearance(guides, body), rest_clearance(points, body)
        self._state, self._steps = RodState.at_rest(self.rods), 0

    @torch.no_grad()
    def at(self, seconds: float) -> Float[Tensor, "strand point 3"]:
        """Points at a time since the wind began to rise.

        The simulation continues from the last requested time, or restarts if that was later.
        """
        self._simulate(max(round(seconds / self.seconds_a_step), 0))
        steps = self.followers.turned(segment_turns(self._state, self.rods))
        return follow_outside(self.roots, steps, self.body, clearance_at(self.clearance, seconds))

    def guides_at(self, seconds: float) -> Float[Tensor, "guide node 3"]:
        """Points of the simulated guides at a time."""
        self._simulate(max(round(seconds / self.seconds_a_step), 0))
        return self._state.points.clone()

    def _simulate(self, steps: int) -> None:
        """Advance (or restart) the guides to the state after a number of steps."""
        if steps < self._steps:
            self._state, self._steps = RodState.at_rest(self.rods), 0
        while self._steps < steps:
            moment = self._steps * self.seconds_a_step
            push = GRAVITY * self.field.at(self._state.points, moment)
            advance(self._state, self.rods, push, self.body, clearance_at(self.guide_clearance, moment))
            self._steps += 1
