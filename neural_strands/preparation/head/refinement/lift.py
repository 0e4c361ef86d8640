"""A lift of the skull: how far it is moved away from the middle of the head, in each direction."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.fit import FittedHead

BROWS, CROWN = 5.0, 55.0
"""Elevations, seen from the middle of the head at the height of the brows, between which the lift sets in, degrees."""
MEASURED = 20.0
"""Degrees above `BROWS` over which the lift sets in where it was measured."""
SHARPNESS = 20.0
"""A measured height counts at an angle a from its place with exp(SHARPNESS * (cos(a) - 1)): one half at 15 degrees."""
ELSEWHERE = 0.2
"""Weight of the height that holds everywhere, relative to a height measured at the very place."""


@dataclass(frozen=True)
class SkullLift:
    """Heights by which a skull is raised.

    Attributes:
        everywhere: height where none was measured nearby, metres; less towards the brows.
        places: unit directions from the middle of the head, with x >= 0: both sides of a head are raised alike.
        heights: heights measured there, metres.
    """

    everywhere: float
    places: Float[Tensor, "place 3"]
    heights: Float[Tensor, " place"]

    @property
    def is_none(self) -> bool:
        """Whether nothing is raised."""
        return self.everywhere == 0 and not bool((self.heights > 0).any())

    def at(self, fitted: FittedHead, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
        """Height of the lift at points of the skull, metres; NaN for NaN."""
        share, outward = upwards(fitted, points)
        near = torch.exp(SHARPNESS * (mirrored(outward) @ self.places.T - 1.0))
        measured = near @ self.heights * smoothstep((elevation(outward) - BROWS) / MEASURED)
        return (measured + ELSEWHERE * self.everywhere * share) / (near.sum(dim=1) + ELSEWHERE)

    def applied(self, fitted: FittedHead) -> FittedHead:
        """The head with its skull and its landmarks raised."""
        mesh = fitted.head.mesh
        vertices, landmarks = (self._raised(fitted, points) for points in (mesh.vertices, fitted.landmarks))
        return replace(fitted, head=replace(fitted.head, mesh=replace(mesh, vertices=vertices)), landmarks=landmarks)

    def _raised(self, fitted: FittedHead, points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
        _, outward = upwards(fitted, points)
        return points + self.at(fitted, points)[:, None] * outward


def upwards(
    fitted: FittedHead, points: Float[Tensor, "point 3"]
) -> tuple[Float[Tensor, " point"], Float[Tensor, "point 3"]]:
    """Share of the lift at points of the skull, and the unit direction in which they are raised; NaN for NaN."""
    brows = fitted.landmarks[[NAMED["right_brow_inner"], NAMED["left_brow_inner"]], 1].nanmean()
    vertices = fitted.head.mesh.vertices
    above = vertices[vertices[:, 1] > brows]
    middle = torch.stack([above[:, 0].mean(), brows, above[:, 2].mean()])
    outward = torch.nn.functional.normalize(points - middle, dim=1)
    return smoothstep((elevation(outward) - BROWS) / (CROWN - BROWS)), outward


def elevation(outward: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
    """Elevation of unit directions, degrees."""
    return torch.rad2deg(outward[:, 1].clamp(-1, 1).asin())


def mirrored(outward: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
    """Directions of the right half moved to the left half."""
    return torch.cat([outward[:, :1].abs(), outward[:, 1:]], dim=1)
