"""The part of a photograph that a step of the fit uses, and the part of that which carries a loss."""

import torch
from jaxtyping import Bool
from torch import Tensor

from neural_strands.geometry.rectangle import Rectangle


def random_square(
    marked: Bool[Tensor, "height width"] | None, size: tuple[int, int], side: int, stride: int, random: torch.Generator
) -> Rectangle:
    """Choose a square around a random marked pixel, aligned to the image generator's levels.

    Args:
        marked: pixels that may be the middle, by default all; if none is marked, the middle of the image is used.
        size: height and width of the image.
        side: side of the square, pixels; a smaller image is used whole.
        stride: the corner is a multiple of this many pixels.
        random: draws the pixel.
    """
    height, width = size
    row, column = height // 2, width // 2
    if marked is None:
        row, column = (int(torch.randint(length, (1,), generator=random)) for length in size)
    else:
        inside = marked.flatten().nonzero().squeeze(1)
        if len(inside):
            row, column = divmod(int(inside[int(torch.randint(len(inside), (1,), generator=random))]), width)
    across, down = min(side, width), min(side, height)
    left = _aligned(column - across // 2, width - across, stride)
    top = _aligned(row - down // 2, height - down, stride)
    return Rectangle(left, top, across, down)


def inner_part(size: tuple[int, int], margin: int) -> Rectangle:
    """The part of a region that carries a loss; at the border the image generator lacks context.

    Args:
        size: height and width of the region.
        margin: pixels left out on every side, if the region is large enough.
    """
    height, width = size
    edge = margin if min(size) > 4 * margin else 0
    return Rectangle(edge, edge, width - 2 * edge, height - 2 * edge)


def _aligned(start: int, last: int, stride: int) -> int:
    """The largest multiple of `stride` that is not above `start`, which is first clamped to [0, last]."""
    return max(0, min(start, last)) // stride * stride
