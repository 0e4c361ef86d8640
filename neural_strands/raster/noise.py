"""Random numbers that every device draws alike, each from a seed and its place."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float32
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.raster.kernels.noise import draw_normal


def normal_noise(size: Sequence[int], random: torch.Generator, device: torch.device) -> Float32[Tensor, "*size"]:
    """Draw from the normal distribution, on the device; a GPU would have to wait for as many numbers from the host.

    Args:
        size: of the tensor.
        random: a generator on the CPU, which draws the seed.
        device: where; each has the same numbers, except for rounding.
    """
    seed = int(torch.randint(2**31 - 1, (), generator=random))
    values = kernels.zeros((math.prod(size),), torch.float32, device)
    kernels.launch_split(draw_normal, len(values), [seed, kernels.array(values)], device)
    return values.view(*size)
