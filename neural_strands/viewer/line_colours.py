"""Strands and segments as lines for a browser: a limited number of them, with colours."""

from typing import Literal, get_args

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands, directions
from neural_strands.pictures.encoding import to_bytes
from neural_strands.pictures.lines import direction_colour

Colouring = Literal["hair colour", "direction", "root position", "seen or guessed"]
COLOURINGS: tuple[Colouring, ...] = get_args(Colouring)
MOST_LINES = 120_000
"""Number of straight pieces that a browser draws smoothly without a graphics card."""
POINTS = 20
"""Largest number of points per strand as drawn."""
PLAIN = (0.45, 0.30, 0.18)
"""Colour of strands that have none of their own, sRGB."""
SEEN, GUESSED = (0.25, 0.55, 0.85), (0.95, 0.45, 0.10)
"""Colours of strands that photographs saw and of those that were guessed, sRGB."""
MOSTLY = 0.5
"""Share of a strand's points that no photograph could see, above which it counts as guessed."""


def strand_lines(
    strands: Strands, colouring: Colouring, most: int = MOST_LINES
) -> tuple[Float[np.ndarray, "line 2 3"], UInt8[np.ndarray, "line 2 3"]]:
    """Ends of the straight pieces of strands, and the colour of each end.

    Args:
        strands: world metres; if there are too many, evenly chosen ones are drawn.
        colouring: meaning of the colours.
        most: largest number of pieces.
    """
    count, points, _ = strands.points.shape
    kept = torch.linspace(0, points - 1, min(points, POINTS)).round().long()
    every = max(1, -(-count * (len(kept) - 1) // most))
    thin = strands.select(torch.arange(0, count, every))
    drawn = thin.points[:, kept]
    colour = _colours(thin, drawn, colouring)
    ends = torch.stack([drawn[:, :-1], drawn[:, 1:]], dim=2).reshape(-1, 2, 3)
    colours = torch.stack([colour[:, :-1], colour[:, 1:]], dim=2).reshape(-1, 2, 3)
    finite = ends.isfinite().all(dim=2).all(dim=1)
    return ends[finite].float().numpy(), _line_bytes(colours[finite])


def segment_lines(
    segments: LineSegments, most: int = MOST_LINES
) -> tuple[Float[np.ndarray, "line 2 3"], UInt8[np.ndarray, "line 2 3"]]:
    """Ends of the pieces of line segments, coloured by direction; if there are too many, whole segments are omitted."""
    every = max(1, -(-len(segments) // most))
    lines = segments.select(segments.segment_id % every == 0).lines()
    along = torch.nn.functional.normalize(lines[:, 1] - lines[:, 0], dim=-1)
    return lines.float().numpy(), _line_bytes(direction_colour(along)[:, None].expand(-1, 2, -1))


def _line_bytes(colours: Float[Tensor, "line 2 3"]) -> UInt8[np.ndarray, "line 2 3"]:
    """Convert encoded colours to linear ones, which three.js expects for lines."""
    return to_bytes(to_linear(colours))


def _colours(strands: Strands, drawn: Float[Tensor, "s p 3"], colouring: Colouring) -> Float[Tensor, "s p 3"]:
    if colouring == "direction":
        return direction_colour(directions(drawn))
    if colouring == "root position":
        return _root_colours(strands)[:, None].expand_as(drawn)
    if colouring == "seen or guessed":
        return _seen_colours(strands)[:, None].expand_as(drawn)
    if strands.color is None:
        return drawn.new_tensor(PLAIN).expand_as(drawn)
    return to_srgb(strands.color)[:, None].expand_as(drawn)


def _seen_colours(strands: Strands) -> Float[Tensor, "s 3"]:
    """One colour for strands that photographs saw, another for those that lie mostly where none could see them."""
    seen, guessed = strands.points.new_tensor(SEEN), strands.points.new_tensor(GUESSED)
    if strands.unseen is None:
        return seen.expand(len(strands), 3)
    return torch.where((strands.unseen > MOSTLY)[:, None], guessed, seen)


def _root_colours(strands: Strands) -> Float[Tensor, "s 3"]:
    """Colours that vary over the scalp: by chart coordinates or, without them, by position of the roots."""
    roots = strands.points[:, 0] if strands.root_uv is None else strands.root_uv
    low, high = roots.amin(dim=0), roots.amax(dim=0)
    place = (roots - low) / (high - low).clamp(min=1e-9)
    return torch.cat([place[:, :2], 1 - place[:, :1]], dim=1)
