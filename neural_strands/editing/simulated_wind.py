"""Simulated wind: guides are elastic rods that the wind pushes (`editing.rods`), and the other strands follow them.

The air pushes a rod with the wind's force tau times its weight, as in the quick wind, and slows it. Guides hold their
lengths and stay outside the body; strands that follow turn with them, keep their own lengths exactly, and are led
around the body where they would enter it. Hair does not collide with hair.

Time is divided into equal steps, counted from the start. A moment is the state after a whole number of them, so it
does not depend on which moments were asked for before.
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
"""Points along a guide."""
STEPS_A_SECOND = 240
"""Least number of steps of time a second."""


class SimulatedHair:
    """Hair in simulated wind at any moment."""

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
        self.followers = Followers.of(points, wind.guides, NODES)
        # A frame is a whole number of steps.
        self.seconds_a_step = 1 / (wind.fps * math.ceil(STEPS_A_SECOND / wind.fps))
        guides = resample_polyline_lengths(points[self.followers.chosen], NODES)
        self.rods = Rods.at_rest(guides, RodConfig(), self.seconds_a_step)
        self.guide_clearance, self.clearance = rest_clearance(guides, body), rest_clearance(points, body)
        self._state, self._steps = RodState.at_rest(self.rods), 0

    @torch.no_grad()
    def at(self, seconds: float) -> Float[Tensor, "strand point 3"]:
        """Points at a moment, counted from when the wind begins to rise.

        The simulation goes on from the moment asked for before, or starts anew where that lies later.
        """
        self._simulate(max(round(seconds / self.seconds_a_step), 0))
        steps = self.followers.turned(segment_turns(self._state, self.rods))
        return follow_outside(self.roots, steps, self.body, clearance_at(self.clearance, seconds))

    def guides_at(self, seconds: float) -> Float[Tensor, "guide node 3"]:
        """Points of the simulated guides at a moment."""
        self._simulate(max(round(seconds / self.seconds_a_step), 0))
        return self._state.points.clone()

    def _simulate(self, steps: int) -> None:
        """Bring the guides to the state after a number of steps."""
        if steps < self._steps:
            self._state, self._steps = RodState.at_rest(self.rods), 0
        while self._steps < steps:
            moment = self._steps * self.seconds_a_step
            push = GRAVITY * self.field.at(self._state.points, moment)
            advance(self._state, self.rods, push, self.body, clearance_at(self.guide_clearance, moment))
            self._steps += 1
