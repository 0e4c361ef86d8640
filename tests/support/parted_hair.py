"""Hair of a ball with a side parting and a fringe, and the few patches of it that stereo might find."""

import torch
from tiny_capture import RADIUS

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import directions

PARTING = 0.5
"""Angle of the parting from the top towards +x, radians."""


def parted_strands(count: int, points: int = 100) -> torch.Tensor:
    """Strands across the ball to both sides of a parting along z: closed forms, random only by a fixed seed.

    Hair rises within 2 cm of its root to 18 mm and then sinks towards the head. What grows between the parting and the
    top climbs, crosses the top level and falls on the other side; in front, it is a fringe that lies on the forehead.
    """
    random = torch.Generator().manual_seed(3)
    root = PARTING + 0.25 - 0.9 * torch.rand(count, generator=random)
    forward = 1.5 * torch.rand(count, generator=random) - 0.75
    along = torch.linspace(0, 1, points)
    angle = root[:, None] + torch.where(root > PARTING, 1.5, -1.5)[:, None] * along
    height = 0.001 + 0.018 * (along / 0.15).clamp(max=1) * (1 - 0.8 * along)
    side = (1 - forward**2).sqrt()[:, None]
    outward = torch.stack([side * angle.sin(), side * angle.cos(), forward[:, None].expand_as(angle)], dim=-1)
    return (RADIUS + height)[:, None] * outward


def patches(strands: torch.Tensor, apart: float, radius: float) -> LineSegments:
    """Pieces of the strands, from root to tip, inside balls about points of the outer hair; the rest is not found.

    Args:
        strands: hair of the ball.
        apart: least distance between the balls' centres, metres.
        radius: of the balls, metres.
    """
    outer = strands[strands.norm(dim=-1) > RADIUS + 0.006]
    left = outer[torch.randperm(len(outer), generator=torch.Generator().manual_seed(0))[:20_000]]
    centres = []
    while len(left):
        centres.append(left[0])
        left = left[(left - left[0]).norm(dim=-1) > apart]
    found = (torch.cdist(strands, torch.stack(centres)) < radius).any(dim=-1)
    begins = found & ~torch.nn.functional.pad(found, (1, -1))
    ids = (begins.reshape(-1).cumsum(0) - 1)[found.reshape(-1)]
    return LineSegments(strands[found], directions(strands)[found], torch.ones(len(ids)), ids)
