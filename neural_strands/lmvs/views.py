"""What line-based multi-view stereo needs of a view: a camera, and images that are read only when their turn comes."""

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera


@dataclass(frozen=True)
class View:
    """One photograph and where it was taken from.

    Attributes:
        camera: calibrated, without lens distortion; its name is what messages and files call the view.
        load_image: reads the photograph, sRGB in [0, 1].
        load_mask: reads the coverage of hair in [0, 1]; None where the capture has no masks.
    """

    camera: Camera
    load_image: Callable[[], Float[Tensor, "height width 3"]]
    load_mask: Callable[[], Float[Tensor, "height width"]] | None = None
