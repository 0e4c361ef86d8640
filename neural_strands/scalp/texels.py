"""Position of each texel of a scalp texture on the scalp."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import Roots, roots_at

ON_CHART = 1e-6
"""Distance in uv within which a texel's centre counts as lying on the chart."""


@dataclass(frozen=True)
class ScalpTexels:
    """The texels of a square texture, row by row: that of row i, column j lies at v = (i + 0.5) / R, u = (j + 0.5) / R.

    Texels off the chart take the closest position on it, so that textures can be filled to their borders.

    Attributes:
        face: index into the head's `scalp_faces`.
        barycentric: weights of that face's corners.
        valid: whether the texel's centre lies on the chart.
        nearest_valid: flat index (row * R + column) of the closest texel that is valid; itself where valid.
    """

    face: Int64[Tensor, "resolution resolution"]
    barycentric: Float[Tensor, "resolution resolution 3"]
    valid: Bool[Tensor, "resolution resolution"]
    nearest_valid: Int64[Tensor, "resolution resolution"]

    def roots(self, head: Head) -> Roots:
        """Positions, uv and frames of all texels, row by row."""
        return roots_at(head, self.face.reshape(-1), self.barycentric.reshape(-1, 3))

    def fill(
        self, texture: Float[Tensor, "resolution resolution channel"]
    ) -> Float[Tensor, "resolution resolution channel"]:
        """Give every texel off the chart the value of its nearest valid one."""
        return texture.reshape(-1, texture.shape[-1])[self.nearest_valid]


def scalp_texels(head: Head, resolution: int) -> ScalpTexels:
    """Find every texel's face and barycentric weights (closest point in the plane of the chart).

    Raises:
        ValueError: no texel's centre lies on the chart.
    """
    device = head.scalp_uv.device
    centre = (torch.arange(resolution, device=device) + 0.5) / resolution
    v, u = torch.meshgrid(centre, centre, indexing="ij")
    chart = torch.nn.functional.pad(head.scalp_uv.reshape(-1, 2), (0, 1))
    corners = torch.arange(len(chart), device=device).reshape(-1, 3)
    closest = closest_points(torch.stack([u, v, torch.zeros_like(u)], dim=-1).reshape(-1, 3), Mesh(chart, corners))
    square = (resolution, resolution)
    valid = (closest.distance < ON_CHART).reshape(square)
    if not valid.any():
        raise ValueError(f"a texture of {resolution} x {resolution} has no texel on the chart")
    row, column = (
        torch.from_numpy(distance_transform_edt(~valid.cpu().numpy(), return_distances=False, return_indices=True))
        .to(device)
        .long()
    )
    return ScalpTexels(
        closest.face.reshape(square),
        closest.barycentric.reshape(*square, 3),
        valid,
        row * resolution + column,
    )
