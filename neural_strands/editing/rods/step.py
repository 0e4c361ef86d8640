"""Steps of time for rods: an implicit step with bending and weight, then lengths and the body as constraints.

Lengths are projected as in Goldenthal et al., "Efficient Simulation of Inextensible Cloth" (2007): Newton's method on
all lengths of a rod together, which is a tridiagonal system. Between these steps, points inside the body are moved to
its surface, with friction. A last pass from root to tip removes remaining errors, so that every resulting state has the
lengths of rest and no point inside.
"""

from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float, Float64
from torch import Tensor

from neural_strands.editing.kernels import rods as rod_kernels
from neural_strands.editing.rods.rods import Rods
from neural_strands.foundation import kernels
from neural_strands.geometry.distance_grid import SignedDistanceGrid

ROUNDS = 4
"""Number of times that lengths and the body are enforced per step, and that a segment is rotated in the last pass."""
FRICTION = 0.1
"""Share of the motion along the body's surface that is undone each time."""


@dataclass(frozen=True)
class RodState:
    """State of rods at one time, modified by `advance`.

    Attributes:
        points: metres.
        velocity: metres per second; the root's is not used.
    """

    points: Float[Tensor, "rod point 3"]
    velocity: Float[Tensor, "rod point 3"]

    @classmethod
    def at_rest(cls, rods: Rods) -> "RodState":
        """The state of rods that have not moved."""
        return cls(rods.rest.clone(), torch.zeros_like(rods.rest))


@torch.no_grad()
def advance(
    state: RodState,
    rods: Rods,
    push: Float[Tensor, "rod point 3"],
    body: SignedDistanceGrid | None,
    clearance: Float[Tensor, "rod point"],
) -> None:
    """Move rods by one step, in place.

    Args:
        state: the state to update.
        rods: the rods at rest, with the factored matrix of the step.
        push: acceleration by the wind, m / s^2.
        body: signed distance to what rods must not enter, if anything.
        clearance: least height of each point above the body, metres; the root's is not used.
    """
    moved = unconstrained(state, rods, push)
    inverse_mass = 1 / rods.mass
    inverse_mass[:, 0] = 0.0
    device = rods.rest.device
    if body is None:
        around = [wp.vec3(0.0), 1.0, kernels.array(torch.zeros(2, 2, 2, device=device)), 0]
    else:
        around = [wp.vec3(*body.grid.origin), body.grid.spacing, kernels.array(body.values.float()), 1]
    constrain = [
        rods.seconds,
        FRICTION,
        ROUNDS,
        kernels.array(rods.rest, wp.vec3),
        *(kernels.array(values) for values in (rods.length, inverse_mass, clearance)),
        *around,
        kernels.array(moved, wp.vec3d),
        *(kernels.array(torch.zeros_like(rods.length)) for _ in range(2)),
        kernels.array(state.points, wp.vec3),
        kernels.array(state.velocity, wp.vec3),
    ]
    kernels.launch_split(rod_kernels.constrain, len(rods.rest), constrain, device)


@torch.no_grad()
def unconstrained(state: RodState, rods: Rods, push: Float[Tensor, "rod point 3"]) -> Float64[Tensor, "rod point 3"]:
    """Displacement from rest after a step without constraints on lengths and the body."""
    moved = torch.zeros_like(rods.rest, dtype=torch.float64)
    inputs = [
        rods.seconds,
        rods.config.drag,
        kernels.array(rods.rest, wp.vec3),
        *(kernels.array(values) for values in (rods.length, rods.mass, rods.stiffness)),
        *(kernels.array(values) for values in (rods.diagonal, rods.first_below, rods.second_below)),
        kernels.array(state.points, wp.vec3),
        kernels.array(state.velocity, wp.vec3),
        kernels.array(push, wp.vec3),
        kernels.array(segment_turns(state, rods), wp.quat),
        kernels.array(moved, wp.vec3d),
    ]
    kernels.launch_split(rod_kernels.bend, len(moved), inputs, moved.device)
    return moved


def segment_turns(state: RodState, rods: Rods) -> Float[Tensor, "rod segment 4"]:
    """Rotation of every segment relative to rest, transported from the root without twist, as x y z w."""
    turns = state.points.new_zeros(*rods.length.shape, 4)
    inputs = [
        kernels.array(rods.rest, wp.vec3),
        kernels.array(rods.length),
        kernels.array(state.points, wp.vec3),
        kernels.array(turns, wp.quat),
    ]
    kernels.launch_split(rod_kernels.measure_turns, len(turns), inputs, turns.device)
    return turns
