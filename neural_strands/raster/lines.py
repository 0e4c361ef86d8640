"""Hard rasterisation of strands: the segment that each pixel sees (paper, "Differentiable Rasterization").

The line rule. A projected segment is stepped along its major axis (x where |dx| >= |dy|): a pixel column whose centre
lies in the half-open span of the segment gets one pixel, the row that the line crosses there. So a line is one pixel
wide, a centre shared by two consecutive segments is drawn once, and the visible point lies exactly on its line, within
its pixel, at the centre along the major axis. Segments that reach behind the near plane are cut there. A segment with
an end that is NaN or infinite is not drawn.
"""

import functools
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.raster import line_kernels
from neural_strands.raster.keys import background_keys, empty_keys, run_together

SEGMENTS_PER_THREAD = 4
"""Consecutive segments that one CUDA thread draws; on the CPU one item is a whole strand."""


@dataclass(frozen=True)
class LineConfig:
    """How strands are drawn."""

    near: float = 0.01
    """Distance of the near plane from the camera, metres."""
    occluder_bias: float = 0.002
    """How far behind an occluder's surface hair still shows, metres: hair that lies on the skin must not flicker."""


DEFAULT_LINES = LineConfig()


@dataclass(frozen=True)
class LineBuffer:
    """What each pixel sees of the strands.

    Attributes:
        segment: global segment index, strand * (points - 1) + k for the segment from point k to k + 1; -1 where none.
        position: where on that segment, from 0 at point k to 1 at point k + 1, perspective-correct; 0 where none.
        depth: metres along the optical axis; infinite where none.
    """

    segment: Int64[Tensor, "height width"]
    position: Float32[Tensor, "height width"]
    depth: Float32[Tensor, "height width"]


def rasterise_lines(
    points: Float[Tensor, "strand point 3"],
    camera: Camera,
    occluder_depth: Float[Tensor, "height width"] | None = None,
    config: LineConfig = DEFAULT_LINES,
) -> LineBuffer:
    """Find the nearest strand point of each pixel; the same result on every run.

    No gradient passes: `visible.visible_points` takes the buffer and gives points that have one.

    Args:
        points: strands in world metres; there may be none.
        camera: the view; its size is the buffer's.
        occluder_depth: depth of the head and body along the optical axis, metres, infinite where there is none.
        config: near plane and bias.

    Raises:
        ValueError: strands of one point, or an occluder of another size than the camera.
    """
    strands, per_strand = _checked_sizes(points, camera, occluder_depth)
    height, width, device = camera.height, camera.width, points.device
    keys = empty_keys(height, width, device)
    if occluder_depth is not None:
        keys = background_keys(occluder_depth.detach().to(device) + config.occluder_bias)
    vertices = kernels.array(points.float().reshape(-1, 3), wp.vec3)
    projection = kernels.array(projection_matrix(camera, device)[None], wp.mat44)
    run = SEGMENTS_PER_THREAD if device.type == "cuda" else per_strand
    runs = -(-(per_strand - 1) // run)
    shared = [vertices, projection, config.near, per_strand, runs, run, width, height]
    keys = _draw(keys, strands * runs, shared)
    buffer = LineBuffer(
        torch.zeros_like(keys), torch.zeros_like(keys, dtype=torch.float32), torch.zeros_like(keys, dtype=torch.float32)
    )
    outputs = [kernels.array(plane.view(-1)) for plane in (buffer.segment, buffer.position, buffer.depth)]
    resolved = [kernels.array(keys.view(-1)), vertices, projection, config.near, per_strand, width, *outputs]
    kernels.launch_split(line_kernels.resolve_lines, height * width, resolved, device)
    return buffer


def projection_matrix(camera: Camera, device: torch.device) -> Float32[Tensor, "4 4"]:
    """World metres to pixel x * depth, pixel y * depth, depth and 1."""
    matrix = camera.world_to_camera.detach().float().clone()
    matrix[:3] = camera.intrinsics.detach().float() @ matrix[:3]
    return matrix.to(device)


def _draw(keys: Int64[Tensor, "height width"], items: int, shared: list) -> Int64[Tensor, "height width"]:
    """Draw all items; on the CPU every thread draws its share into keys of its own, and the least of them stay."""
    kernel, device = line_kernels.draw_lines, keys.device
    kernels.load(kernel, device)
    threads = min(torch.get_num_threads(), items) if device.type == "cpu" else 1
    if threads < 2:
        kernels.launch(kernel, items, [0, *shared, kernels.array(keys.view(-1))], device)
        return keys
    planes = [keys, *(keys.clone() for _ in range(threads - 1))]
    bounds = [items * share // threads for share in range(threads + 1)]
    run_together(
        [
            functools.partial(
                kernels.launch,
                kernel,
                bounds[share + 1] - bounds[share],
                [bounds[share], *shared, kernels.array(planes[share].view(-1))],
                device,
            )
            for share in range(threads)
        ]
    )
    return functools.reduce(torch.minimum, planes)


def _checked_sizes(
    points: Float[Tensor, "strand point 3"], camera: Camera, occluder_depth: Float[Tensor, "..."] | None
) -> tuple[int, int]:
    strands, per_strand, _ = points.shape
    if per_strand < 2:
        raise ValueError(f"a strand needs at least two points, got {per_strand}")
    if strands * per_strand >= 2**31:
        raise ValueError(f"at most 2^31 points can be drawn at once, got {strands} strands of {per_strand} points")
    size = (camera.height, camera.width)
    if occluder_depth is not None and tuple(occluder_depth.shape) != size:
        raise ValueError(f"occluder depth has shape {tuple(occluder_depth.shape)}, the camera's image is {size}")
    return strands, per_strand
