"""A photograph to be matched, and parts of it."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.model.hair_model import Drawing


@dataclass(frozen=True)
class Observation:
    """A photograph to be matched.

    Attributes:
        camera: its view.
        image: sRGB in [0, 1].
        mask: coverage of hair, if it is known.
        drawing: what the camera sees of the strands, if they stay as they are.
    """

    camera: Camera
    image: Float[Tensor, "height width 3"]
    mask: Float[Tensor, "height width"] | None = None
    drawing: Drawing | None = None

    def cropped(self, left: int, top: int, width: int, height: int) -> "Observation":
        """Part of the photograph, with the camera that sees just that."""
        part = (slice(top, top + height), slice(left, left + width))
        mask = None if self.mask is None else self.mask[part]
        drawing = self.drawing
        if drawing is not None:
            factor = drawing.lines.depth.shape[0] // self.camera.height
            drawing = drawing.cropped(left * factor, top * factor, width * factor, height * factor)
        return Observation(self.camera.cropped(left, top, width, height), self.image[part], mask, drawing)
