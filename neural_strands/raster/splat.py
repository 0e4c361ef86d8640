"""Soft rasterisation: points splatted bilinearly to their neighbouring pixels (paper, "Differentiable Rasterization").

At a pixel u the map is h_u = sum(w g) / sum(w) over the points that reach it, w being the bilinear weight times the
point's amount (1 unless given). Where the sum of weights is below `minimum_weight`, that is the divisor instead: a
point that barely touches a pixel fades in rather than filling it, and gradients stay bounded by 1 / minimum_weight.
"""

import functools
from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation import kernels
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.raster.kernels import splats as splat_kernels
from neural_strands.raster.quads import QUAD, quads, whole_quads
from neural_strands.raster.reference import splat_reference

MINIMUM_WEIGHT = 0.1
"""Default of the smallest divisor of the weighted mean."""


class SplatMap(NamedTuple):
    """Splatted features at one resolution.

    Attributes:
        features: weighted means, zero where nothing was splatted; channels-last in memory.
        coverage: sum of the weights, zero where nothing was splatted.
    """

    features: Float[Tensor, "channel height width"]
    coverage: Float[Tensor, "height width"]

    def cropped(self, part: Rectangle) -> "SplatMap":
        """A part of the map."""
        return SplatMap(part.of(self.features.permute(1, 2, 0)).permute(2, 0, 1), part.of(self.coverage))


def splat(
    pixels: Float[Tensor, "point 2"],
    features: Float[Tensor, "point channel"],
    size: tuple[int, int],
    minimum_weight: float = MINIMUM_WEIGHT,
    amounts: Float[Tensor, " point"] | None = None,
) -> SplatMap:
    """Splat points to an image, with gradients to their positions and features.

    Args:
        pixels: x and y in pixels, pixel centres at +0.5; points outside contribute only the part that falls on the
            image.
        features: what each point carries.
        size: height and width of the image.
        minimum_weight: least divisor of the weighted mean.
        amounts: weight of each point, by default 1; receives no gradient.
    """
    return splat_pyramid(pixels, features, size, 1, minimum_weight, amounts)[0]


def splat_pyramid(
    pixels: Float[Tensor, "point 2"],
    features: Float[Tensor, "point channel"],
    size: tuple[int, int],
    levels: int,
    minimum_weight: float = MINIMUM_WEIGHT,
    amounts: Float[Tensor, " point"] | None = None,
) -> list[SplatMap]:
    """Splat points to an image and its successive halvings, in one pass over the points.

    Level l has ceil(height / 2^l) by ceil(width / 2^l) pixels, each 2^l pixels of the image wide.
    Tensors that are not float32 take the plain torch path.
    """
    if features.dtype != torch.float32 or pixels.dtype != torch.float32:
        return splat_pyramid_reference(pixels, features, size, levels, minimum_weight, amounts)
    amounts = pixels.new_ones(len(pixels)) if amounts is None else amounts.to(pixels.dtype)
    sizes = _level_sizes(size, levels)
    flat = _Splat.apply(pixels, features, sizes, minimum_weight, amounts)
    return _maps(list(zip(flat[0::2], flat[1::2], strict=True)), sizes)


def splat_pyramid_reference(
    pixels: Float[Tensor, "point 2"],
    features: Float[Tensor, "point channel"],
    size: tuple[int, int],
    levels: int,
    minimum_weight: float = MINIMUM_WEIGHT,
    amounts: Float[Tensor, " point"] | None = None,
) -> list[SplatMap]:
    """`splat_pyramid` by scattered sums of torch, one level after the other."""
    amounts = pixels.new_ones(len(pixels)) if amounts is None else amounts.to(pixels.dtype)
    sizes = _level_sizes(size, levels)
    planes = [splat_reference(pixels, features, sizes[k], 0.5**k, minimum_weight, amounts) for k in range(levels)]
    return _maps(planes, sizes)


def _level_sizes(size: tuple[int, int], levels: int) -> list[tuple[int, int]]:
    """Height and width of each level."""
    return [(-(-size[0] // 2**level), -(-size[1] // 2**level)) for level in range(levels)]


def _maps(planes: list[tuple[Tensor, Tensor]], sizes: list[tuple[int, int]]) -> list[SplatMap]:
    """Flattened means and weights of the levels as maps."""
    return [
        SplatMap(mean.view(height, width, -1).permute(2, 0, 1), weight.view(height, width))
        for (mean, weight), (height, width) in zip(planes, sizes, strict=True)
    ]


class _Splat(torch.autograd.Function):
    """The splat by kernels; returns the flattened means and weights of each level in turn."""

    @staticmethod
    def forward(
        ctx: Any,
        pixels: Tensor,
        features: Tensor,
        sizes: list[tuple[int, int]],
        minimum_weight: float,
        amounts: Tensor,
    ) -> tuple[Tensor, ...]:
        channels = features.shape[1]
        features = whole_quads(features)
        planes = [
            (features.new_zeros(height * width, features.shape[1]), features.new_zeros(height * width))
            for height, width in sizes
        ]
        _accumulate(pixels, amounts, features, sizes, planes)
        for means, weights in planes:
            inputs = [minimum_weight, kernels.array(weights), quads(means)]
            kernels.launch_split(splat_kernels.normalise, len(weights), inputs, features.device)
        ctx.save_for_backward(pixels, amounts, features, *(plane for pair in planes for plane in pair))
        ctx.sizes, ctx.minimum_weight, ctx.channels = sizes, minimum_weight, channels
        ctx.set_materialize_grads(False)
        return tuple(plane for means, weights in planes for plane in (means[:, :channels], weights))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor | None) -> tuple[Tensor | None, ...]:
        pixels, amounts, features, *flat = ctx.saved_tensors
        # The pixels of strands that stay where they are need no gradient, which would take most of the time.
        grad_pixels = torch.zeros_like(pixels) if ctx.needs_input_grad[0] else None
        grad_features = torch.zeros_like(features)
        points = [kernels.array(pixels, wp.vec2), kernels.array(amounts)]
        for level, (height, width) in enumerate(ctx.sizes):
            grads, (means, weights) = gradients[2 * level : 2 * level + 2], flat[2 * level : 2 * level + 2]
            if grads[0] is None and (grads[1] is None or grad_pixels is None):
                continue
            # Zeros, which `whole_quads` does not promise: the added channels must not move the points.
            missing = means.shape[1] - ctx.channels
            grad_means = torch.zeros_like(means) if grads[0] is None else F.pad(grads[0], (0, missing))
            at, place = [0.5**level, width, height, ctx.minimum_weight], kernels.array(weights)
            if grad_pixels is None:
                # One CUDA thread adds one quad: neighbours then read and write neighbouring memory.
                count = means.shape[1] // QUAD
                run = 1 if pixels.device.type == "cuda" else count
                inputs = [*points, *at, run, place, quads(grad_means), quads(grad_features)]
                items = len(pixels) * (count // max(run, 1))
                kernels.launch_split(splat_kernels.gather_feature_gradients, items, inputs, pixels.device)
                continue
            grad_weights = torch.zeros_like(weights) if grads[1] is None else grads[1]
            inputs = [*points, quads(features), *at, quads(means), place, quads(grad_means)]
            inputs += [kernels.array(grad_weights), kernels.array(grad_pixels, wp.vec2), quads(grad_features)]
            kernels.launch_split(splat_kernels.gather_gradients, len(pixels), inputs, pixels.device)
        return grad_pixels, grad_features[:, : ctx.channels], None, None, None


def _accumulate(
    pixels: Tensor,
    amounts: Tensor,
    features: Tensor,
    sizes: list[tuple[int, int]],
    planes: list[tuple[Tensor, Tensor]],
) -> None:
    """Sum weighted features and weights; on the CPU each thread visits all points for its own band of rows."""
    device, channels = features.device, features.shape[1]
    on_gpu = device.type == "cuda"
    # One CUDA thread adds one quad; on the CPU one item is a whole point, if possible as a single vector.
    as_rows = not on_gpu and channels == splat_kernels.ROW and not kernels.is_traced(features)
    kernel = splat_kernels.accumulate_rows if as_rows else splat_kernels.accumulate
    vectors = _rows if as_rows else quads
    kernels.load(kernel, device)
    bands = 1 if on_gpu else kernels.cpu_threads()
    count = max(channels // QUAD, 1)
    run = [] if as_rows else [1 if on_gpu else count]
    items = len(pixels) * (count if on_gpu else 1)
    points = [kernels.array(pixels, wp.vec2), kernels.array(amounts), vectors(features)]
    jobs = [[] for _ in range(bands)]
    for level, ((height, width), (sums, weights)) in enumerate(zip(sizes, planes, strict=True)):
        outputs = [vectors(sums), kernels.array(weights)]
        for band in range(bands):
            rows = [height * band // bands, height * (band + 1) // bands]
            inputs = [*points, 0.5**level, width, *rows, *run, *outputs]
            jobs[band].append(functools.partial(kernels.launch, kernel, items, inputs, device))
    kernels.run_together([functools.partial(_run_all, band) for band in jobs])


def _rows(features: Tensor) -> Any:
    """All channels of each item as one vector."""
    return kernels.array(features.contiguous().view(len(features), 1, splat_kernels.ROW), splat_kernels.Row)


def _run_all(jobs: list) -> None:
    for job in jobs:
        job()
