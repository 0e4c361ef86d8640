"""Grows smooth strands: they leave the scalp, are combed, fall, and slide over the head in layers."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.scalp.roots import Roots
from neural_strands.synthesis.comb import ScalpFrame, comb_directions
from neural_strands.synthesis.shorten import shorten
from neural_strands.synthesis.styles import Style

POINTS = 100
"""Points of every strand."""
STIFF_LENGTH = 0.03
"""Length over which gravity sets in (m)."""
LAYER_SLOPE = 0.25
"""Slope at which a strand may climb to its layer: height over length."""
HOLD = 0.88
"""Share of gravity cancelled by friction while hair rests on the upper head and stays where it is combed."""
HOLD_HEIGHT = 0.008
"""Height above its layer over which this friction is lost (m)."""
CLEARANCE = 0.0006
"""Least height of a strand above the skin, away from its root (m)."""


def grow(
    roots: Roots, frame: ScalpFrame, grid: SignedDistanceGrid, style: Style, generator: torch.Generator
) -> Float[Tensor, "root 100 3"]:
    """Integrate one smooth strand of POINTS points from each root.

    Each step bends the direction towards the ground, moves forward, and is lifted to the strand's layer above the skin
    if it would fall below it. The step keeps its length, so arc lengths are those of the style.
    """
    normals = roots.normal
    count, device = len(normals), normals.device
    length = strand_lengths(roots.position, frame, style, generator)
    step = length[:, None] / (POINTS - 1)
    layer = style.thickness * (0.25 + 0.75 * _uniform(count, generator, device))
    comb = comb_directions(roots.position, normals, frame, style)
    direction = torch.nn.functional.normalize(comb + style.lift * normals, dim=-1)
    hold_level = frame.centre[1] - 0.4 * frame.half_size[1]
    down = normals.new_tensor([0.0, -1.0, 0.0])
    point, points = roots.position, [roots.position]
    above, outward = point.new_zeros(count, 1), normals
    for index in range(1, POINTS):
        arc = step * index
        held = torch.exp(-above / HOLD_HEIGHT) * ((point[:, 1:2] - hold_level) / HOLD_HEIGHT).clamp(0.0, 1.0)
        pull = style.gravity * (arc / STIFF_LENGTH).clamp(max=1.0) * (1 - HOLD * held) * step
        across = down - (direction * down).sum(dim=-1, keepdim=True) * direction
        settle = style.cling * (above / HOLD_HEIGHT).clamp(max=1.0) * step
        direction = torch.nn.functional.normalize(direction + pull * across - settle * outward, dim=-1)
        height = torch.minimum(layer[:, None], CLEARANCE + LAYER_SLOPE * arc)
        direction, above, outward = _lifted(point, direction, step, height, grid)
        point = point + step * direction
        points.append(point)
    return cut_at_height(torch.stack(points, dim=1), _tip_level(roots, style, generator))


def strand_lengths(
    positions: Float[Tensor, "root 3"], frame: ScalpFrame, style: Style, generator: torch.Generator
) -> Float[Tensor, " root"]:
    """Desired arc lengths (metres): full at the crown, shorter below, varying between strands."""
    share = style.side_length + (1 - style.side_length) * frame.height(positions).sqrt()
    noise = torch.randn(len(positions), generator=generator, device=generator.device).to(positions.device)
    return style.length * share * (1 + style.length_variation * noise.clamp(-2.5, 2.5))


def cut_at_height(
    points: Float[Tensor, "strand point 3"], level: Float[Tensor, " strand"] | None
) -> Float[Tensor, "strand point 3"]:
    """End strands where they first sink below a height given per strand (metres); the number of points stays."""
    if level is None:
        return points
    count = points.shape[1]
    below = points[:, :, 1] < level[:, None]
    last = torch.where(below.any(dim=1), below.float().argmax(dim=1), count - 1).clamp(min=count // 8)
    return shorten(points, last.to(points))


def _tip_level(roots: Roots, style: Style, generator: torch.Generator) -> Float[Tensor, " root"] | None:
    if style.tip_level is None:
        return None
    ragged = _uniform(len(roots.position), generator, roots.position.device)
    return roots.position[:, 1].amin() - style.tip_level + (ragged**2) * 4 * style.length_variation * 0.1


def _lifted(
    point: Float[Tensor, "root 3"],
    direction: Float[Tensor, "root 3"],
    step: Float[Tensor, "root 1"],
    height: Float[Tensor, "root 1"],
    grid: SignedDistanceGrid,
) -> tuple[Float[Tensor, "root 3"], Float[Tensor, "root 1"], Float[Tensor, "root 3"]]:
    """Turn directions so that a step ends `height` above the skin or climbs towards it.

    Returns:
        The direction, the height above `height` at which the step ends (metres), and the outward direction there.
    """
    above, outward = torch.zeros_like(height), torch.zeros_like(point)
    for _ in range(2):
        distance, outward = grid.with_outward(point + step * direction)
        above = distance[:, None] - height
        missing = (-above).clamp(min=0.0).minimum(step)
        direction = torch.nn.functional.normalize(direction + missing / step * outward, dim=-1)
    return direction, above.clamp(min=0.0), outward


def _uniform(count: int, generator: torch.Generator, device: torch.device) -> Float[Tensor, " {count}"]:
    return torch.rand(count, generator=generator, device=generator.device).to(device)
