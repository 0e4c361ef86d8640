"""A procedural groom: strands of a style on any head, with their widths and colours."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import sample_roots
from neural_strands.synthesis.collision import keep_outside
from neural_strands.synthesis.comb import ScalpFrame
from neural_strands.synthesis.detail import add_detail
from neural_strands.synthesis.grow import grow
from neural_strands.synthesis.pigment import draw_melanin, melanin_colour
from neural_strands.synthesis.styles import Melanin, Style

FULL_HEAD = 100_000
"""Number of strands on a real head."""
NATURAL_WIDTH = 0.00008
"""Thickness of a real strand (m)."""
GRID_SPACING, GRID_MARGIN = 0.006, 0.03
"""Spacing of the grid of distances used while growing, metres."""
FEWEST, MOST = 100, 1_000_000
"""Smallest and largest number of strands of a groom."""


def make_groom(head: Head, style: Style, melanin: Melanin, count: int, generator: torch.Generator) -> Strands:
    """Grow `count` strands of a style on a head; the same generator state gives the same strands.

    Raises:
        InputError: the count is out of range.
    """
    if not FEWEST <= count <= MOST:
        raise InputError(f"strands: expected {FEWEST} to {MOST}, found {count}; choose a number between.")
    roots = sample_roots(head, count, generator)
    normals = roots.normal
    grid = SignedDistanceGrid.build(head.mesh, GRID_SPACING, GRID_MARGIN)
    points = grow(roots, ScalpFrame.of(head), grid, style, generator)
    points = add_detail(points, normals, style, generator)
    points = keep_outside(points, grid, head.mesh)
    pigment = draw_melanin(melanin, len(points), generator).to(points)
    return Strands(points, roots.uv, normals, covering_widths(points), melanin_colour(pigment))


def covering_widths(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
    """Full thickness (metres), tapering towards the tip.

    A groom with fewer strands than a real head has thicker ones, so that they cover the head. The factor is the square
    root of the ratio, which keeps single strands distinguishable.
    """
    count, size, _ = points.shape
    shortage = math.sqrt(max(FULL_HEAD / count, 1.0))
    along = torch.linspace(0.0, 1.0, size, dtype=points.dtype, device=points.device)
    taper = 1.0 - 0.65 * along**3
    return (NATURAL_WIDTH * min(shortage, 6.0) * taper).expand(count, size)
