"""The direction in which hair is combed at its root: away from a parting in front, around a whorl at the crown."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.scalp.head import Head
from neural_strands.synthesis.styles import Style

WHORL_ELEVATION = 0.96
"""Angle of the whorl above the horizontal, towards the back, seen from the middle of the scalp (rad)."""
WHORL_REACH = 0.045
"""Distance over which the whorl's turn fades (m)."""
PARTING_REACH = 0.05
"""Distance to the parting over which hair is combed straight away from it (m)."""


@dataclass(frozen=True)
class ScalpFrame:
    """Position and size of the scalp in the world (y up, +z out of the face).

    Attributes:
        centre: middle of its bounding box, in metres.
        half_size: half the box's extent along x, y, z in metres.
        whorl: the point about which the crown's hair turns.
    """

    centre: Float[Tensor, "3"]
    half_size: Float[Tensor, "3"]
    whorl: Float[Tensor, "3"]

    @classmethod
    def of(cls, head: Head) -> "ScalpFrame":
        """Measure a head's scalp."""
        corners = head.mesh.vertices[head.mesh.faces[head.scalp_faces]].reshape(-1, 3)
        low, high = corners.amin(dim=0), corners.amax(dim=0)
        centre = (low + high) / 2
        towards = centre.new_tensor([0.12, math.sin(WHORL_ELEVATION), -math.cos(WHORL_ELEVATION)])
        offset = torch.nn.functional.normalize(corners - centre, dim=-1)
        whorl = corners[(offset @ torch.nn.functional.normalize(towards, dim=0)).argmax()]
        return cls(centre, (high - low) / 2, whorl)

    def height(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Height of points between the lowest (0) and the highest (1) point of the scalp."""
        return ((points[..., 1] - self.centre[1]) / (2 * self.half_size[1]) + 0.5).clamp(0.0, 1.0)


def comb_directions(
    positions: Float[Tensor, "root 3"], normals: Float[Tensor, "root 3"], frame: ScalpFrame, style: Style
) -> Float[Tensor, "root 3"]:
    """Unit directions along the scalp in which hair leaves its roots.

    The whorl sends hair away from itself, turned sideways; a parting in front of the whorl sends it to either side and
    a little backwards; low on the head everything points down.
    """
    away = _along(positions - frame.whorl, normals)
    distance = (positions - frame.whorl).norm(dim=-1, keepdim=True)
    turn = style.whorl_turn * torch.exp(-distance / WHORL_REACH)
    radial = turn.cos() * away + turn.sin() * torch.linalg.cross(normals, away, dim=-1)
    down = _along(positions.new_tensor([0.0, -1.0, 0.0]).expand_as(positions), normals)
    low = (1.0 - 2.2 * frame.height(positions)).clamp(0.0, 1.0)[:, None]
    direction = radial * (1 - low) + down * low
    if style.parting is not None:
        side = positions[:, 0] - frame.centre[0] - style.parting
        ahead = ((positions[:, 2] - frame.whorl[2]) / frame.half_size[2]).clamp(0.0, 1.0)
        lateral = torch.stack([torch.sign(side), -0.35 * torch.ones_like(side), -0.35 - 0.55 * ahead], dim=-1)
        close = torch.exp(-((side / (2 * PARTING_REACH)) ** 2))
        weight = torch.maximum((8.0 * ahead).clamp(max=1.0) * close, 0.75 * ahead)[:, None]
        direction = direction * (1 - weight) + _along(lateral, normals) * weight
    return _along(direction, normals)


def _along(vectors: Float[Tensor, "root 3"], normals: Float[Tensor, "root 3"]) -> Float[Tensor, "root 3"]:
    """Normalised tangential parts of vectors."""
    tangential = vectors - (vectors * normals).sum(dim=-1, keepdim=True) * normals
    return torch.nn.functional.normalize(tangential, dim=-1)
