"""A part of an image."""

from dataclasses import dataclass

from jaxtyping import Shaped
from torch import Tensor
from torch.nn import functional as F


@dataclass(frozen=True)
class Rectangle:
    """A rectangle of pixels: column and row of its top left pixel, and its size."""

    left: int
    top: int
    width: int
    height: int

    def of(self, image: Shaped[Tensor, "height width *channels"]) -> Shaped[Tensor, "rows columns *channels"]:
        """This part of an image."""
        return image[self.top : self.top + self.height, self.left : self.left + self.width]

    def padded(
        self, part: Shaped[Tensor, "{self.height} {self.width} channel"], height: int, width: int
    ) -> Shaped[Tensor, "{height} {width} channel"]:
        """An image of which this rectangle shows `part` and the rest is zero: the inverse of `of`."""
        right, bottom = width - self.left - self.width, height - self.top - self.height
        return F.pad(part, (0, 0, self.left, right, self.top, bottom))

    def reduced(self, factor: int) -> "Rectangle":
        """The same part of an image of 1 / `factor` the size, rounded up; the corner must be a multiple of `factor`."""
        return Rectangle(self.left // factor, self.top // factor, -(-self.width // factor), -(-self.height // factor))
