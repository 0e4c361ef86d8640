"""One-dimensional filters along one axis of a tensor, by kernels of our own, with gradients to the values.

For GPUs: cuDNN takes ten to a hundred times as long for one filter per channel, and longer still for its gradient. On
the CPU torch's convolutions are faster.
"""

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.raster.kernels import fir as fir_kernels
from neural_strands.raster.kernels.fir import ACTIVATE, GATE, PLAIN

FOUR = 4
"""Values in bfloat16 that a thread computes together."""


@dataclass(frozen=True)
class Filter:
    """A filter and how it samples: output i is the sum over inputs j of taps[j * up - i * down + pad] * input[j].

    Attributes:
        taps: coefficients.
        up: fine samples per input.
        down: fine samples per output.
        pad: fine samples before the first input at which the first output begins.
        gain: factor of all coefficients.
        mirrored: read the coefficients from the last to the first.
    """

    taps: Float[Tensor, " tap"]
    up: int = 1
    down: int = 1
    pad: int = 0
    gain: float = 1.0
    mirrored: bool = False

    def adjoint(self) -> "Filter":
        """The filter that takes gradients of outputs to gradients of inputs."""
        pad = len(self.taps) - 1 - self.pad
        return replace(self, up=self.down, down=self.up, pad=pad, mirrored=not self.mirrored)


def filtered(values: Float[Tensor, "*size"], by: Filter, axis: int, length: int) -> Float[Tensor, "*new_size"]:
    """Filter along one axis; values beyond its ends are zero.

    Args:
        values: the result has their type, and is computed in float32; images in channels-last memory stay in it.
        by: the filter.
        axis: which axis.
        length: number of outputs along it.
    """
    return _Filtered.apply(values, by, axis, length)


class _Filtered(torch.autograd.Function):
    """`filtered`, with gradients to the values."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, by: Filter, axis: int, length: int) -> Tensor:
        ctx.by, ctx.axis, ctx.length = by, axis, values.shape[axis]
        return _run(values, by, axis, length)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        return _run(gradients[0], ctx.by.adjoint(), ctx.axis, ctx.length), None, None, None


def activated_at_twice(
    images: Float[Tensor, "batch channel height width"],
    taps: Float[Tensor, " tap"],
    pad: int,
    slope: float,
    gain: float,
) -> Float[Tensor, "batch channel height width"]:
    """Leaky ReLU at twice the resolution: filtered on the way up, activated, filtered on the way down.

    Args:
        images: the images.
        taps: coefficients on the fine grid.
        pad: zeros before the first sample that centre them.
        slope: of the leaky ReLU for negative values.
        gain: factor of the result.
    """
    return _ActivatedAtTwice.apply(images, taps, pad, slope, gain)


class _ActivatedAtTwice(torch.autograd.Function):
    """`activated_at_twice`; only the activated fine samples are kept, and the gradient passes them in one kernel."""

    @staticmethod
    def forward(ctx: Any, images: Tensor, taps: Tensor, pad: int, slope: float, gain: float) -> Tensor:
        height, width = images.shape[2:]
        up = Filter(taps, down=2, pad=pad, gain=2.0).adjoint()
        down = Filter(taps, down=2, pad=pad, gain=math.sqrt(gain))
        fine = _run(_run(images, up, 2, 2 * height), up, 3, 2 * width, slope)
        ctx.up, ctx.down, ctx.slope = up, down, slope
        ctx.save_for_backward(fine)
        return _run(_run(fine, down, 3, width), down, 2, height)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None, None]:
        (fine,) = ctx.saved_tensors
        up, down = ctx.up.adjoint(), ctx.down.adjoint()
        height, width = fine.shape[2:]
        found = _run(_run(gradients[0], down, 2, height), down, 3, width, ctx.slope, fine)
        return _run(_run(found, up, 3, width // 2), up, 2, height // 2), None, None, None, None


def _run(
    values: Tensor, by: Filter, axis: int, length: int, activation: float | None = None, gate: Tensor | None = None
) -> Tensor:
    """Run the kernel.

    A leaky ReLU of slope `activation` follows, if there is one; with `gate`, what it returned, its gradient follows.
    """
    axis %= values.ndim
    if values.ndim == 4 and values.stride(1) == 1 < values.shape[1]:
        # Gradients of some of the channels are not contiguous, but their channels are still last.
        values = values.contiguous(memory_format=torch.channels_last)
        order = (0, 2, 3, 1)
        inside = None if gate is None else gate.permute(order)
        place = order.index(axis)
        found = _run_flat(values.permute(order), by, place, length, activation, inside)
        return found.permute(0, 3, 1, 2)
    return _run_flat(values.contiguous(), by, axis, length, activation, gate)


def _run_flat(
    values: Tensor, by: Filter, axis: int, length: int, activation: float | None, gate: Tensor | None
) -> Tensor:
    """`_run` for contiguous values."""
    shape = values.shape
    inner = math.prod(shape[axis + 1 :])
    together = FOUR if values.dtype == torch.bfloat16 else 1
    if values.dtype not in (torch.float32, torch.bfloat16) or inner % together or values.storage_offset() % together:
        floats = None if gate is None else gate.float()
        return _run_flat(values.float(), by, axis, length, activation, floats).to(values.dtype)
    result = values.new_zeros((*shape[:axis], length, *shape[axis + 1 :]))
    finish = PLAIN if activation is None else ACTIVATE if gate is None else GATE
    described = _described(
        (by.up, by.down, by.pad, len(by.taps), by.mirrored, by.gain),
        (shape[axis], length, inner // together),
        (finish, activation or 0.0),
    )
    kernel = fir_kernels.filter_fours if together == FOUR else fir_kernels.filter_floats
    arrays = [_words(each) for each in (values, values if gate is None else gate.contiguous(), result)]
    inputs = [kernels.array(by.taps.float()), described, *arrays]
    kernels.launch_split(kernel, result.numel() // together, inputs, values.device)
    return result


@functools.lru_cache(maxsize=1024)
def _described(by: tuple[int, int, int, int, bool, float], sizes: tuple[int, int, int], end: tuple[int, float]) -> Any:
    """The kernel's description of a filter and an axis; setting its members takes the host longer than the launch."""
    axis = fir_kernels.Axis()
    axis.up, axis.down, axis.pad, axis.taps, mirrored, axis.gain = by
    axis.origin, axis.turn = (axis.taps - 1, -1) if mirrored else (0, 1)
    axis.length, axis.new_length, axis.inner = sizes
    axis.finish, axis.slope = end
    return axis


def _words(values: Tensor) -> Any:
    """All values; four of bfloat16 as one number."""
    flat = values.view(-1)
    return kernels.array(flat) if values.dtype == torch.float32 else kernels.array(flat.view(torch.int64), wp.uint64)
