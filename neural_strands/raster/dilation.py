"""Growing masks by a disc or a square."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.foundation import kernels
from neural_strands.foundation.devices.transfers import sent
from neural_strands.raster.kernels.dilation import grow_by_disc


def dilate(mask: Bool[Tensor, "height width"], radius: int) -> Bool[Tensor, "height width"]:
    """Grow a mask by a disc of `radius` pixels; the area beyond the border is empty."""
    if radius < 1 or not mask.numel():
        return mask
    before = functional.pad(mask.cumsum(1, dtype=torch.int32), (1, 0))
    halves = [math.isqrt(radius * radius - step * step) for step in range(-radius, radius + 1)]
    reach = sent(torch.tensor(halves, dtype=torch.int32), mask.device)
    grown = torch.zeros(mask.shape, dtype=torch.uint8, device=mask.device)
    inputs = [kernels.array(before), kernels.array(reach), radius, kernels.array(grown)]
    kernels.launch_split(grow_by_disc, mask.numel(), inputs, mask.device)
    return grown.bool()


def widen(image: Float[Tensor, "height width"], radius: int) -> Float[Tensor, "height width"]:
    """Largest value up to `radius` pixels away along rows and columns; nothing lies beyond the border."""
    if radius < 1:
        return image
    # Columns, then rows: the same bits as the whole square, in a fraction of the time.
    columns = functional.max_pool2d(image[None, None], (2 * radius + 1, 1), 1, (radius, 0))
    return functional.max_pool2d(columns, (1, 2 * radius + 1), 1, (0, radius))[0, 0]
