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
from jaxtyping import Float, Float32, Int32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.raster.kernels import triangles as triangle_kernels
from neural_strands.raster.keys import empty_keys, key_index
from neural_strands.raster.lines import projection_matrix

STRIPES = 16
"""Number of CUDA threads that share the rows of one face."""
NEAR = 0.01
"""Default distance of the near plane from the camera, metres."""


@dataclass(frozen=True)
class TriangleBuffer:
    """The nearest face at each pixel.

    Attributes:
        keys: depth and face of each pixel (see `keys`).
        depth: metres along the optical axis; infinite where none.
        vertices: of the mesh that was drawn, in homogeneous pixels (x * depth, y * depth, depth).
        faces: its vertex indices.
    """

    keys: Int64[Tensor, "height width"]
    depth: Float32[Tensor, "height width"]
    vertices: Float32[Tensor, "vertex 3"]
    faces: Int32[Tensor, "face 3"]

    @functools.cached_property
    def face(self) -> Int64[Tensor, "height width"]:
        """Index of the nearest face, -1 where none."""
        return key_index(self.keys)

    @functools.cached_property
    def barycentric(self) -> Float32[Tensor, "height width 3"]:
        """Weights of the face's corners, perspective-correct; zero where none."""
        (height, width), device = self.keys.shape, self.keys.device
        barycentric = kernels.zeros((height, width, 3), torch.float32, device)
        outputs = [width, kernels.array(barycentric.view(-1, 3), wp.vec3)]
        inputs = [kernels.array(self.keys.view(-1)), *self.mesh(), *outputs]
        kernels.launch_split(triangle_kernels.resolve_weights, height * width, inputs, device)
        return barycentric

    def mesh(self) -> list[Any]:
        """The mesh as kernels read it."""
        return [kernels.array(self.vertices, wp.vec3), kernels.array(self.faces, wp.vec3i)]


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
    projected = torch.zeros(vertices.shape, device=device)
    inputs = [
        kernels.array(vertices.float(), wp.vec3),
        kernels.array(projection_matrix(camera, device)[None], wp.mat44),
        kernels.array(projected, wp.vec3),
    ]
    kernels.launch_split(triangle_kernels.project_vertices, len(vertices), inputs, device)
    depth = kernels.zeros((height, width), torch.float32, device)
    buffer = TriangleBuffer(empty_keys(height, width, device), depth, projected, faces.int())
    keys = kernels.array(buffer.keys.view(-1))
    if device.type == "cuda":
        inputs = [*buffer.mesh(), near, width, 0, height, STRIPES, keys]
        kernels.launch(triangle_kernels.draw_triangles, len(faces) * STRIPES, inputs, device)
    else:
        _draw_in_bands([*buffer.mesh(), near, width], len(faces), height, keys)
    outputs = [keys, kernels.array(depth.view(-1))]
    kernels.launch_split(triangle_kernels.resolve_depths, height * width, outputs, device)
    return buffer


def _draw_in_bands(inputs: list[Any], faces: int, height: int, keys: Any) -> None:
    """Draw on the CPU: each thread visits all faces for its own band of rows."""
    kernel, bands = triangle_kernels.draw_triangles_in_lanes, kernels.cpu_threads()
    kernels.load(kernel, "cpu")
    bounds = [height * band // bands for band in range(bands + 1)]
    kernels.run_together(
        [
            functools.partial(kernels.launch, kernel, faces, [*inputs, first, last, keys], "cpu")
            for first, last in itertools.pairwise(bounds)
        ]
    )
