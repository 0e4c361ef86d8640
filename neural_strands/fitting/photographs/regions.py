"""The part of a photograph that a step of the fit uses, and the part of that which carries a loss."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Int64
from torch import Tensor

from neural_strands.geometry.rectangle import Rectangle


@dataclass(frozen=True)
class MarkedPixels:
    """The marked pixels of an image on the host, as runs of consecutive ones row after row.

    There are few runs, so they can be kept for every photograph; a GPU has to be asked for them only once.

    Attributes:
        start: index of each run's first pixel, row * width + column.
        before: number of marked pixels before each run, followed by that of all.
    """

    start: Int64[np.ndarray, " run"]
    before: Int64[np.ndarray, " run_and_end"]

    @classmethod
    def of(cls, marked: Bool[Tensor, "height width"]) -> "MarkedPixels":
        """Find the runs."""
        flat = np.pad(marked.cpu().numpy().ravel().astype(np.int8), 1)
        start, end = np.flatnonzero(np.diff(flat)).astype(np.int64).reshape(-1, 2).T
        return cls(start, np.concatenate([np.zeros(1, np.int64), np.cumsum(end - start)]))

    def __len__(self) -> int:
        return int(self.before[-1])

    def __getitem__(self, number: int) -> int:
        """Index of the marked pixel with this number, counted from 0 row after row."""
        run = int(np.searchsorted(self.before, number, side="right")) - 1
        return int(self.start[run] + number - self.before[run])


def random_square(
    marked: MarkedPixels | None, size: tuple[int, int], side: int, stride: int, random: torch.Generator
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
    elif len(marked):
        row, column = divmod(marked[int(torch.randint(len(marked), (1,), generator=random))], width)
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
