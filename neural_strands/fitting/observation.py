"""A photograph that the fit should match, and regions of it."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Shaped
from torch import Tensor

from neural_strands.geometry.cameras import Camera


@dataclass(frozen=True)
class Place:
    """A rectangle of pixels."""

    left: int
    top: int
    width: int
    height: int

    def of(self, image: Shaped[Tensor, "height width *channels"]) -> Shaped[Tensor, "rows columns *channels"]:
        """This part of an image."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def without_margin(self, margin: int) -> "Place":
        """The part of a region that carries a loss; at the border the image generator lacks context."""
        edge = margin if min(self.height, self.width) > 4 * margin else 0
        return Place(self.left + edge, self.top + edge, self.width - 2 * edge, self.height - 2 * edge)


@dataclass(frozen=True)
class Observation:
    """A photograph to be matched.

    Attributes:
        camera: its view.
        image: sRGB in [0, 1].
        mask: coverage of hair, if it is known.
    """

    camera: Camera
    image: Float[Tensor, "height width 3"]
    mask: Float[Tensor, "height width"] | None = None

    def cropped(self, place: Place) -> "Observation":
        """Part of the photograph, with the camera that sees exactly that part."""
        mask = None if self.mask is None else place.of(self.mask)
        return Observation(
            self.camera.cropped(place.left, place.top, place.width, place.height), place.of(self.image), mask
        )


def random_place(
    marked: Bool[Tensor, "height width"] | None, size: tuple[int, int], side: int, stride: int, random: torch.Generator
) -> Place:
    """A square around a random marked pixel, aligned to the image generator's levels.

    Args:
        marked: where the middle may lie, by default anywhere; the middle of the image where nothing is marked.
        size: height and width of the image.
        side: of the square, pixels; an image no larger is taken whole.
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
    return Place(left, top, across, down)


def _aligned(start: int, last: int, stride: int) -> int:
    """The multiple of `stride` nearest below `start` that lies in [0, last]."""
    return max(0, min(start, last)) // stride * stride
