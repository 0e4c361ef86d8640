"""Resampling by two and pointwise nonlinearities that keep their band limit (StyleGAN3 paper, section 3).

On the CPU plain torch convolutions, one per channel and axis, in channels-last memory; activations without gradients
have a kernel of their own. On CUDA, where such convolutions are slow, the filters of `fir`. Grids are aligned by pixel
areas: a coarse pixel covers `factor` fine ones.
"""

import functools
import math
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation import kernels as launches
from neural_strands.raster.fir import Filter, activated_at_twice, filtered
from neural_strands.raster.kernels.activations import (
    CHANNELS,
    CLAMP,
    LEAKY_SLOPE,
    REACH,
    SPAN,
    TAPS,
    Span,
    filtered_activation,
)
from neural_strands.raster.kernels.activations import Filter as Coefficients

Images = Float[Tensor, "batch channel height width"]
Resampled = Float[Tensor, "batch channel new_height new_width"]

LEAKY_GAIN = math.sqrt(2.0)
TILE = 128
"""Columns that the CPU's kernel filters together; what it keeps of them fits into the cache."""


def upsample(images: Images, kernel: Float[Tensor, " tap"], factor: int = 2) -> Resampled:
    """Interpolate to `factor` times as many pixels; `kernel` (even taps, sum one) runs on the fine grid."""
    channel, pad = images.shape[1], _alignment(kernel, factor)
    if images.device.type == "cuda":
        up = Filter(kernel, down=factor, pad=pad, gain=float(factor)).adjoint()
        height, width = images.shape[2:]
        return filtered(filtered(images, up, 2, factor * height), up, 3, factor * width)
    vertical, horizontal = _axes(kernel * factor, images)
    tall = F.conv_transpose2d(images, vertical, stride=(factor, 1), padding=(pad, 0), groups=channel)
    return F.conv_transpose2d(tall, horizontal, stride=(1, factor), padding=(0, pad), groups=channel)


def downsample(images: Images, kernel: Float[Tensor, " tap"], factor: int = 2) -> Resampled:
    """Low-pass and keep one pixel in `factor`; `kernel` (even taps, sum one) runs on the fine grid.

    Raises:
        ValueError: a side is not a multiple of `factor`.
    """
    _, channel, height, width = images.shape
    if height % factor or width % factor:
        raise ValueError(f"downsampling by {factor} needs sides that it divides, found {height} x {width}")
    pad = _alignment(kernel, factor)
    if images.device.type == "cuda":
        down = Filter(kernel, down=factor, pad=pad)
        return filtered(filtered(images, down, 3, width // factor), down, 2, height // factor)
    vertical, horizontal = _axes(kernel, images)
    narrow = F.conv2d(images, horizontal, stride=(1, factor), padding=(0, pad), groups=channel)
    return F.conv2d(narrow, vertical, stride=(factor, 1), padding=(pad, 0), groups=channel)


def leaky_relu(images: Images, bias: Float[Tensor, " channel"]) -> Images:
    """Bias, leaky ReLU, variance-preserving gain and clamp; pointwise, so its output is not band-limited."""
    activated = F.leaky_relu(images + _per_channel(bias, images), LEAKY_SLOPE)
    return (activated * LEAKY_GAIN).clamp(-CLAMP, CLAMP)


def filtered_leaky_relu(images: Images, bias: Float[Tensor, " channel"], kernel: Float[Tensor, " tap"]) -> Images:
    """Leaky ReLU applied at twice the resolution, so that the frequencies it adds above the band limit can be removed.

    `kernel` interpolates on the way up and removes the new frequencies on the way down. The gain is part of the second
    pass and the clamp follows it, because at twice the resolution a pointwise step costs as much as a filter.
    """
    if _is_fused(images, bias, kernel):
        return _fused_leaky_relu(images, bias, kernel)
    if images.device.type == "cuda":
        shifted = images + _per_channel(bias, images)
        found = activated_at_twice(shifted, kernel, _alignment(kernel, 2), LEAKY_SLOPE, LEAKY_GAIN)
        return found.clamp(-CLAMP, CLAMP)
    fine = upsample(images + _per_channel(bias, images), kernel)
    activated = F.leaky_relu(fine, LEAKY_SLOPE, inplace=True)
    return downsample(activated, kernel * math.sqrt(LEAKY_GAIN)).clamp(-CLAMP, CLAMP)


def _is_fused(images: Images, bias: Float[Tensor, " channel"], kernel: Float[Tensor, " tap"]) -> bool:
    """Whether one kernel does the whole activation: on the CPU, without gradients, for suitable sizes."""
    if images.device.type != "cpu" or images.dtype != torch.float32 or launches.is_traced(images):
        return False
    if torch.is_autocast_enabled("cpu") or (torch.is_grad_enabled() and (images.requires_grad or bias.requires_grad)):
        return False
    if images.shape[1] % CHANNELS or len(kernel) != TAPS or images.numel() == 0:
        return False
    return _tiling(images.shape[3])[1] * images.shape[1] >= SPAN * CHANNELS


def _fused_leaky_relu(images: Images, bias: Float[Tensor, " channel"], kernel: Float[Tensor, " tap"]) -> Images:
    """`filtered_leaky_relu` as one kernel: each thread takes a band of rows."""
    batch, channel, height, width = images.shape
    pixels = images.permute(0, 2, 3, 1).contiguous()
    result = launches.zeros(pixels.shape, torch.float32, images.device)
    tile, _ = _tiling(width)
    rows = -(-height // torch.get_num_threads())
    across = -(-width // tile)
    filters = [Coefficients(*(kernel * gain).tolist()) for gain in (2.0, math.sqrt(LEAKY_GAIN))]
    repeated = _spans(bias.detach().to(images).repeat(tile + 2 * REACH))
    sizes = [height, width, channel // CHANNELS, rows, tile]

    def band(source: Tensor, target: Tensor, number: int) -> None:
        # Every thread has work arrays of its own.
        sizes_of_work = (tile + 2 * REACH, tile + REACH, tile + REACH, 2 * TAPS * tile)
        work = [_spans(launches.zeros([size * channel], torch.float32, source.device)) for size in sizes_of_work]
        inputs = [number * across, _spans(source), repeated, *filters, *sizes, *work, _spans(target)]
        launches.launch(filtered_activation, across, inputs, "cpu")

    launches.load(filtered_activation, "cpu")
    bands = range(-(-height // rows))
    for image in range(batch):
        jobs = [functools.partial(band, pixels[image], result[image], number) for number in bands]
        launches.run_together(jobs)
    return result.permute(0, 3, 1, 2)


def _tiling(width: int) -> tuple[int, int]:
    """Columns of a tile, at most `TILE`, and of the last tile, which is as wide or a little narrower."""
    tile = -(-width // -(-width // TILE))
    return tile, width - (-(-width // tile) - 1) * tile


def _spans(values: Tensor) -> Any:
    """All spans of vectors, which overlap each other."""
    flat = values.view(-1)
    launches.start_warp()
    spans = flat.as_strided((len(flat) // CHANNELS - SPAN + 1, SPAN * CHANNELS), (CHANNELS, 1), flat.storage_offset())
    return wp.from_torch(spans, dtype=Span, requires_grad=False)


def _per_channel(bias: Float[Tensor, " channel"], images: Images) -> Float[Tensor, "channel 1 1"]:
    return bias.to(images)[:, None, None]


def _alignment(kernel: Float[Tensor, " tap"], factor: int) -> int:
    """Number of zeros before the first sample that centres the kernel on the coarse pixel: (taps - factor) / 2."""
    extra = len(kernel) - factor
    if extra < 0 or extra % 2:
        raise ValueError(f"a kernel of {len(kernel)} taps cannot be centred on pixels {factor} times as wide")
    return extra // 2


def _axes(kernel: Float[Tensor, " tap"], images: Images) -> tuple[Tensor, Tensor]:
    """The kernel as one vertical and one horizontal filter per channel, in the precision of the images."""
    taps, channel = len(kernel), images.shape[1]
    per_channel = kernel.to(images).repeat(channel, 1)
    return per_channel.view(channel, 1, taps, 1), per_channel.view(channel, 1, 1, taps)
