"""A groom that moves."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Motion:
    """Where the vertices of a groom are over time.

    Attributes:
        fps: frames per second.
        frames: number of frames.
        vertices: the vertices in a frame, counted from 0, in the groom's unit and order.
    """

    fps: float
    frames: int
    vertices: Callable[[int], Float[Tensor, "vertex 3"]]
