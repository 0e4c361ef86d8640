"""Rods at rest: masses, stiffness, and the factored matrix of an implicit step.

All quantities are divided by mass per length, so that hair of any thickness moves alike. A rod has three energies:

- **Bending** (discrete elastic rods, Bergou et al. 2008): the change of direction at a point differs from that of the
  groom, which the rod carries along without twisting, as a rod does whose tip is free. So curls stay curls.
- **Weight.** The photographed hair already hangs, lies on the head and leans on other hair. The load that holds it is
  unknown; it is assumed to pull every segment along its own direction at rest, with the weight of everything below it.
  Then the groom is in equilibrium without any bending, a straight hanging strand feels exactly its weight, and in a
  wind of force tau over weight a direction m turns towards m + tau w, as in the quick wind.
- **Length**, which is a constraint and not an energy (`rods.step`).

With the transported directions fixed over a step, the first two energies are quadratic in the points, and their matrix
never changes. It has two subdiagonals and is factored once.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from neural_strands.geometry.strands import segments

GRAVITY = 9.81
"""Gravity, metres per second squared."""
BENDING_LENGTH = 0.05
"""Length over which a hair bends under its own weight, metres: the cube root of stiffness over weight per length.

A fibre of 80 micrometres, 3.9 GPa and 1,300 kg per cubic metre has 0.05.
"""
DRAG = 6.0
"""Rate at which air and friction between hairs slow a strand, per second."""
SHORTEST_SEGMENT = 1e-6
"""Least length of a segment, metres; shorter ones count as this long, so that nothing is divided by zero."""


@dataclass(frozen=True)
class RodConfig:
    """Material of the rods.

    Attributes:
        bending: stiffness over mass per length, m^4 / s^2.
        gravity: acceleration that determines the weight at rest, m / s^2.
        drag: rate at which motion through still air fades, per second.
    """

    bending: float = GRAVITY * BENDING_LENGTH**3
    gravity: float = GRAVITY
    drag: float = DRAG


@dataclass(frozen=True)
class Rods:
    """Rods at rest, and the factors L D L^T of the matrix of a step.

    Attributes:
        rest: points, root first, metres.
        length: length of every segment, metres.
        mass: mass of every point, metres (mass over mass per length); the root's counts as infinite.
        stiffness: stiffness of the bend at every point, m^3 / s^2; the root's keeps the first direction.
        diagonal: D at every point but the root, whose entry is not used.
        first_below: first subdiagonal of L.
        second_below: second subdiagonal of L.
        config: their material.
        seconds: duration of the step that the factors are for.
    """

    rest: Float[Tensor, "rod point 3"]
    length: Float[Tensor, "rod point-1"]
    mass: Float[Tensor, "rod point"]
    stiffness: Float[Tensor, "rod point"]
    diagonal: Float64[Tensor, "rod point"]
    first_below: Float64[Tensor, "rod point"]
    second_below: Float64[Tensor, "rod point"]
    config: RodConfig
    seconds: float

    @classmethod
    def at_rest(cls, points: Float[Tensor, "rod point 3"], config: RodConfig, seconds: float) -> "Rods":
        """Build rods with the rest shape `points`, prepared for steps of `seconds`.

        Raises:
            ValueError: there are fewer than two points.
        """
        count = points.shape[1]
        if count < 2:
            raise ValueError(f"rods need at least two points, found {count}")
        length = segments(points).norm(dim=-1).clamp(min=SHORTEST_SEGMENT)
        half = 0.5 * torch.nn.functional.pad(length, (1, 1))
        mass = half[:, :-1] + half[:, 1:]
        bends = config.bending / mass.clamp(min=SHORTEST_SEGMENT)
        bends[:, -1] = 0.0
        bands = _bands(length.double(), mass.double(), bends.double(), config, seconds)
        return cls(points.contiguous(), length, mass, bends, *_factored(*bands), config, seconds)


def _bands(
    length: Float64[Tensor, "rod segment"],
    mass: Float64[Tensor, "rod point"],
    bends: Float64[Tensor, "rod point"],
    config: RodConfig,
    seconds: float,
) -> tuple[Float64[Tensor, "rod point"], Float64[Tensor, "rod point"], Float64[Tensor, "rod point"]]:
    """Diagonal and two subdiagonals of the matrix; entry k of a subdiagonal couples point k to an earlier one."""
    rate = 1 / seconds
    diagonal = rate * (rate + config.drag) * mass
    first, second = torch.zeros_like(diagonal), torch.zeros_like(diagonal)
    # Weight of all points beyond a segment, over the segment's length.
    below = mass[:, 1:].flip(1).cumsum(dim=1).flip(1)
    pull = config.gravity * below / length
    diagonal[:, 1:] += pull
    diagonal[:, :-1] += pull
    first[:, 1:] -= pull
    # The bend at point k: u_{k+1} / l_k - (1 / l_{k-1} + 1 / l_k) u_k + u_{k-1} / l_{k-1}.
    one, two = 1 / length[:, :-1], 1 / length[:, 1:]
    inner = bends[:, 1:-1]
    diagonal[:, :-2] += inner * one * one
    diagonal[:, 1:-1] += inner * (one + two) ** 2
    diagonal[:, 2:] += inner * two * two
    first[:, 1:-1] -= inner * one * (one + two)
    first[:, 2:] -= inner * two * (one + two)
    second[:, 2:] += inner * one * two
    # The scalp fixes the first direction.
    diagonal[:, 1] += bends[:, 0] / length[:, 0] ** 2
    return diagonal, first, second


def _factored(
    diagonal: Float64[Tensor, "rod point"], first: Float64[Tensor, "rod point"], second: Float64[Tensor, "rod point"]
) -> tuple[Float64[Tensor, "rod point"], Float64[Tensor, "rod point"], Float64[Tensor, "rod point"]]:
    """Factors L D L^T of the matrix without the root's row and column."""
    pivots, below, beyond = diagonal.clone(), torch.zeros_like(first), torch.zeros_like(second)
    for k in range(2, diagonal.shape[1]):
        if k > 2:
            beyond[:, k] = second[:, k] / pivots[:, k - 2]
        coupling = first[:, k] - (beyond[:, k] * pivots[:, k - 2] * below[:, k - 1] if k > 2 else 0.0)
        below[:, k] = coupling / pivots[:, k - 1]
        pivots[:, k] -= below[:, k] ** 2 * pivots[:, k - 1] + beyond[:, k] ** 2 * pivots[:, k - 2]
    return pivots, below, beyond
