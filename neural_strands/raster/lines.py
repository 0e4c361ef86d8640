"""Hard rasterisation of strands: the segment that each pixel sees (paper, "Differentiable Rasterization").

The line rule. A projected segment is stepped along its major axis (x where |dx| >= |dy|): a pixel column whose centre
lies in the half-open span of the segment gets one pixel, the row that the line crosses there. So a line is one pixel
wide, a centre shared by two consecutive segments is drawn once, and the visible point lies exactly on its line, within
its pixel, at the centre along the major axis. Strands with a width cover the pixels of each column or row whose centres
lie within that width. A strand much thinner than a pixel may miss all centres, so the number of pixels that it covers
is right on average. Segments that reach behind the near plane are cut there. A segment with an end that is NaN or
infinite is not drawn.
"""

import functools
from dataclasses import dataclass
from typing import Annotated

import torch
import warp as wp
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.foundation.configs import Between
from neural_strands.geometry.cameras import Camera
from neural_strands.raster import occlusion
from neural_strands.raster.kernels import keys as key_kernels
from neural_strands.raster.kernels import line_batches as line_batch_kernel
from neural_strands.raster.kernels import lines as line_kernels

SEGMENTS_PER_THREAD = 4
"""Consecutive segments that one CUDA thread draws. The CPU has kernels of its own (`line_batches`, `occlusion`)."""


@dataclass(frozen=True)
class LineConfig:
    """How strands are drawn."""

    near: Annotated[float, Between(1e-9, 1e6)] = 0.01
    """Distance of the near plane from the camera, metres."""
    occluder_bias: Annotated[float, Between(0, 1)] = 0.002
    """Depth behind an occluder's surface up to which hair is still drawn, metres, so that hair on the skin does not
    flicker."""
    width: Annotated[float, Between(0, 1)] = 0.0
    """Width of strands, metres; 0 draws them one pixel wide at any distance."""
    tip: Annotated[float, Between(0, 1)] = 0.0
    """Share of a strand, at its tip (t = 1), over which it thins to nothing; no effect on lines one pixel wide."""


DEFAULT_LINES = LineConfig()


@dataclass(frozen=True)
class LineBuffer:
    """The nearest strand segment at each pixel.

    Attributes:
        segment: global segment index, strand * (points - 1) + k for the segment from point k to k + 1; -1 if none.
        position: position on that segment, from 0 at point k to 1 at point k + 1, perspective-correct; 0 if none.
        depth: metres along the optical axis; infinite if none.
    """

    segment: Int64[Tensor, "height width"]
    position: Float32[Tensor, "height width"]
    depth: Float32[Tensor, "height width"]


def rasterise_lines(
    points: Float[Tensor, "strand point 3"],
    camera: Camera,
    occluder_depth: Float[Tensor, "height width"] | None = None,
    config: LineConfig = DEFAULT_LINES,
    t: Float[Tensor, "strand point"] | None = None,
) -> LineBuffer:
    """Find the nearest strand point at each pixel; the result is deterministic.

    There is no gradient; `visible.visible_points` turns the buffer into points that have one.

    Args:
        points: strands in world metres; there may be none.
        camera: the view; its size is the buffer's.
        occluder_depth: depth of the head and body along the optical axis, metres, infinite where there is none.
        config: near plane, bias and width.
        t: parameter of every point (`Strands.t`), which determines the taper; None: evenly spaced from 0 to 1.

    Raises:
        ValueError: strands have a single point, or the occluder and the camera differ in size.
    """
    strands, per_strand = _checked_sizes(points, camera, occluder_depth)
    height, width, device = camera.height, camera.width, points.device
    vertices = kernels.array(points.float().reshape(-1, 3), wp.vec3)
    projection = kernels.array(projection_matrix(camera, device)[None], wp.mat44)
    occluder = torch.zeros(0) if occluder_depth is None else occluder_depth.float().reshape(-1)
    hidden_by = [kernels.array(occluder.to(device)), config.occluder_bias]
    shared = [vertices, projection, config.near, per_strand]
    parameters = torch.zeros(0, device=device) if t is None else t.detach().float().reshape(-1)
    taper = [config.width, config.tip, kernels.array(parameters)]
    planes = kernels.zeros((_planes(strands, device), height * width), torch.int64, device)
    drawing = (line_kernels.draw_lines,)
    if device.type == "cpu":
        drawing = occlusion.KERNELS if config.width > 0 else (line_batch_kernel.draw_strands,)
    for kernel in (key_kernels.start_keys, *drawing):
        kernels.load(kernel, device)
    if planes.numel():
        kernels.run_together(
            [functools.partial(_draw, k, planes, strands, hidden_by, shared, taper, width) for k in range(len(planes))]
        )
    segment, position, depth = (
        kernels.zeros((height, width), dtype, device) for dtype in (torch.int64, torch.float32, torch.float32)
    )
    outputs = [kernels.array(plane.view(-1)) for plane in (segment, position, depth)]
    kernels.launch_split(
        line_kernels.resolve_lines, height * width, [kernels.array(planes), *shared, width, *outputs], device
    )
    return LineBuffer(segment, position, depth)


def projection_matrix(camera: Camera, device: torch.device) -> Float32[Tensor, "4 4"]:
    """Matrix from homogeneous world metres to (pixel x * depth, pixel y * depth, depth, 1)."""
    matrix = camera.world_to_camera.detach().float().clone()
    matrix[:3] = camera.intrinsics.detach().float() @ matrix[:3]
    return matrix.to(device)


def _planes(strands: int, device: torch.device) -> int:
    """Number of threads that draw, each into its own plane of keys."""
    return max(min(kernels.cpu_threads(), strands), 1) if device.type == "cpu" else 1


def _draw(
    share: int,
    planes: Int64[Tensor, "plane pixel"],
    strands: int,
    hidden_by: list,
    shared: list,
    taper: list,
    width: int,
) -> None:
    """Draw one share of the strands into its own plane of keys."""
    device, pixels, per_strand = planes.device, planes.shape[1], shared[-1]
    keys, size = kernels.array(planes[share]), [width, pixels // width]
    kernels.launch(key_kernels.start_keys, pixels, [*hidden_by, keys], device)
    first, last = (strands * end // len(planes) for end in (share, share + 1))
    if device.type == "cpu" and taper[0] > 0:
        occlusion.draw_unhidden(first, last - first, shared, taper, size, keys)
        return
    if device.type == "cpu":
        kernels.launch(line_batch_kernel.draw_strands, last - first, [first, *shared, *size, keys], device)
        return
    runs = -(-(per_strand - 1) // SEGMENTS_PER_THREAD)
    inputs = [first * runs, *shared[:-1], *taper, per_strand, runs, SEGMENTS_PER_THREAD, *size, keys]
    kernels.launch(line_kernels.draw_lines, (last - first) * runs, inputs, device)


def _checked_sizes(
    points: Float[Tensor, "strand point 3"], camera: Camera, occluder_depth: Float[Tensor, "..."] | None
) -> tuple[int, int]:
    strands, per_strand, _ = points.shape
    if per_strand < 2:
        raise ValueError(f"a strand needs at least two points, found {per_strand}")
    if strands * per_strand >= 2**31:
        raise ValueError(f"at most 2^31 points can be drawn at once, found {strands} strands of {per_strand} points")
    size = (camera.height, camera.width)
    if occluder_depth is not None and tuple(occluder_depth.shape) != size:
        raise ValueError(f"occluder depth has shape {tuple(occluder_depth.shape)}, the camera's image is {size}")
    return strands, per_strand
