"""Rasterisation of triangle meshes: the face, barycentric coordinates and depth that each pixel's centre sees.

Triangles are drawn from both sides. A pixel is inside a triangle if its three homogeneous barycentric coordinates are
not negative. This needs no clipping: parts nearer than the near plane are left out pixel by pixel.
"""

import functools
import itertools
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.raster.kernels import triangles as triangle_kernels
from neural_strands.raster.keys import empty_keys
from neural_strands.raster.lines import projection_matrix

STRIPES = 16
"""Number of CUDA threads that share the rows of one face."""
NEAR = 0.01
"""Default distance of the near plane from the camera, metres."""


@dataclass(frozen=True)
class TriangleBuffer:
    """The nearest face at each pixel.

    Attributes:
        face: index of the nearest face, -1 where none.
        barycentric: weights of the face's corners, perspective-correct; zero where none.
        depth: metres along the optical axis; infinite where none.
    """

    face: Int64[Tensor, "height width"]
    barycentric: Float32[Tensor, "height width 3"]
    depth: Float32[Tensor, "height width"]


def rasterise_triangles(
    vertices: Float[Tensor, "vertex 3"], faces: Int64[Tensor, "face 3"], camera: Camera, near: float = NEAR
) -> TriangleBuffer:
    """Find the nearest face at each pixel, without gradient. Faces with a vertex that is not finite are not drawn.

    Args:
        vertices: world metres; there may be none.
        faces: vertex indices.
        camera: the view; its size is the buffer's.
        near: distance of the near plane from the camera, metres.
    """
    height, width, device = camera.height, camera.width, vertices.device
    keys = empty_keys(height, width, device)
    mesh = [
        kernels.array(vertices.float(), wp.vec3),
        kernels.array(faces.int(), wp.vec3i),
        kernels.array(projection_matrix(camera, device)[None], wp.mat44),
    ]
    flat_keys = kernels.array(keys.view(-1))
    if device.type == "cuda":
        inputs = [*mesh, near, width, 0, height, STRIPES, flat_keys]
        kernels.launch(triangle_kernels.draw_triangles, len(faces) * STRIPES, inputs, device)
    else:
        _draw_in_bands([*mesh, near, width], len(faces), height, flat_keys)
    buffer = TriangleBuffer(
        torch.zeros_like(keys),
        torch.zeros(height, width, 3, device=device),
        torch.zeros(height, width, device=device),
    )
    outputs = [
        kernels.array(buffer.face.view(-1)),
        kernels.array(buffer.barycentric.view(-1, 3), wp.vec3),
        kernels.array(buffer.depth.view(-1)),
    ]
    kernels.launch_split(
        triangle_kernels.resolve_triangles, height * width, [flat_keys, *mesh, width, *outputs], device
    )
    return buffer


def _draw_in_bands(inputs: list[Any], faces: int, height: int, keys: Any) -> None:
    """Draw on the CPU: each thread visits all faces for its own band of rows."""
    kernel, bands = triangle_kernels.draw_triangles_in_lanes, torch.get_num_threads()
    kernels.load(kernel, "cpu")
    bounds = [height * band // bands for band in range(bands + 1)]
    kernels.run_together(
        [
            functools.partial(kernels.launch, kernel, faces, [*inputs, first, last, keys], "cpu")
            for first, last in itertools.pairwise(bounds)
        ]
    )
