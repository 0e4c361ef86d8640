"""A part of an image."""

from dataclasses import dataclass

from jaxtyping import Shaped
from torch import Tensor


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
