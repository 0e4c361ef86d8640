"""A groom that moves."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Motion:
    """Positions of a groom's vertices over time.

    Attributes:
        fps: frames per second.
        frames: number of frames.
        vertices: function from a frame, counted from 0, to the vertices in it, in the groom's unit and order.
    """

    fps: float
    frames: int
    vertices: Callable[[int], Float[Tensor, "vertex 3"]]
