"""What strands leave open of each pixel, and the colour of the surface behind them.

Strands and surface are drawn at several line pixels per pixel. The kernels go through the line pixels of one pixel at a
time, so that nothing but the pixel's means is written to memory.
"""

from typing import Any, NamedTuple

import torch
import warp as wp
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.raster.kernels import openings as opening_kernels
from neural_strands.raster.triangles import TriangleBuffer


class Openings(NamedTuple):
    """Shares of each pixel's line pixels.

    Attributes:
        surface: share that shows the surface, whether strands are in front of it or not.
        open_surface: share that shows the surface and no strand.
        open: share that shows no strand.
    """

    surface: Float32[Tensor, "height width"]
    open_surface: Float32[Tensor, "height width"]
    open: Float32[Tensor, "height width"]


def openings(
    depth: Float32[Tensor, "fine_height fine_width"], segment: Int64[Tensor, "fine_height fine_width"], factor: int
) -> Openings:
    """Count what strands leave open of each pixel.

    Args:
        depth: of the surface at every line pixel; infinite where there is none.
        segment: the nearest segment of a strand at every line pixel; negative where there is none.
        factor: line pixels for each pixel, along each axis; those beyond the last whole pixel are ignored.
    """
    height, width = (side // factor for side in depth.shape)
    shares = [kernels.zeros((height, width), torch.float32, depth.device) for _ in range(3)]
    inputs = [kernels.array(depth), kernels.array(segment), width, factor]
    inputs += [kernels.array(share.view(-1)) for share in shares]
    kernels.launch_split(opening_kernels.count_openings, height * width, inputs, depth.device)
    return Openings(*shares)


def surface_colours(
    texture: Float[Tensor, "texel_rows texel_columns 3"],
    corner_uv: Float[Tensor, "face 3 2"],
    seen: TriangleBuffer,
    factor: int,
    changes: Float[Tensor, "vertex 5"] | None = None,
) -> Float32[Tensor, "height width 3"]:
    """Mean colour of a textured surface over the line pixels of each pixel that show it, with gradient to the texture.

    Args:
        texture: colours, sampled bilinearly.
        corner_uv: texture coordinates of every face's corners.
        seen: the surface, drawn at line pixels.
        factor: line pixels for each pixel, along each axis; those beyond the last whole pixel are ignored.
        changes: at every vertex, a factor f, a share s and a colour c, by which a sample x of the texture becomes
            `lerp(f * x, c, s)`; without gradient.

    Returns:
        Colours; zero where there is no surface.
    """
    changes = texture.new_zeros(0, 5) if changes is None else changes
    return _SurfaceColours.apply(texture, corner_uv, changes, seen, factor)


class _SurfaceColours(torch.autograd.Function):
    """`surface_colours` by kernels."""

    @staticmethod
    def forward(
        ctx: Any, texture: Tensor, corner_uv: Tensor, changes: Tensor, seen: TriangleBuffer, factor: int
    ) -> Tensor:
        height, width = (side // factor for side in seen.keys.shape)
        colour = kernels.zeros((height, width, 3), torch.float32, texture.device)
        inputs = [*_surface(corner_uv, changes, seen), width, factor]
        inputs += [kernels.array(texture.float(), wp.vec3), kernels.array(colour.view(-1, 3), wp.vec3)]
        kernels.launch_split(opening_kernels.mean_colour, height * width, inputs, texture.device)
        ctx.save_for_backward(corner_uv, changes)
        ctx.seen, ctx.factor, ctx.size = seen, factor, texture.shape
        return colour

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        (corner_uv, changes), (height, width, _) = ctx.saved_tensors, gradients[0].shape
        found = kernels.zeros(ctx.size, torch.float32, gradients[0].device)
        inputs = [*_surface(corner_uv, changes, ctx.seen), width, ctx.factor]
        inputs += [kernels.array(gradients[0].reshape(-1, 3), wp.vec3), kernels.array(found, wp.vec3)]
        kernels.launch(opening_kernels.scatter_to_texture, height * width, inputs, found.device)
        return found, None, None, None, None


def _surface(corner_uv: Float[Tensor, "face 3 2"], changes: Float[Tensor, "some 5"], seen: TriangleBuffer) -> list[Any]:
    """A drawn surface as kernels read it."""
    surface = [kernels.array(corner_uv.float(), wp.vec2), kernels.array(changes.float())]
    return [kernels.array(seen.keys), *seen.mesh(), *surface]
