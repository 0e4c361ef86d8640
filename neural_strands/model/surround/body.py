"""The body behind the hair: a mesh with learned linear colours, in a texture where each face has texels of its own."""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.foundation.configs import Between
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.raster.face_atlas import FaceAtlas
from neural_strands.raster.openings import surface_colours
from neural_strands.raster.texture import sample_picture
from neural_strands.raster.triangles import TriangleBuffer, rasterise_triangles

START = 0.2
"""Initial colour of body and background, linear: mid grey."""


@dataclass(frozen=True)
class SurroundConfig:
    """Sizes of what lies behind the hair."""

    body_texture: Annotated[int, Between(1, 4096)] = 896
    """Texels per side of the body's texture, at most; more if the mesh has too many faces."""
    body_texel: Annotated[float, Between(1e-5, 1)] = 0.0015
    """Finest texel of the body, metres: about a pixel of the photographs, which leave gaps between smaller ones."""
    background_texture: Annotated[int, Between(1, 4096)] = 768
    """Texels of the background from pole to pole; twice as many around it."""
    background_directions: Annotated[int, Between(1, 1024)] = 180
    """Directions from pole to pole in which the background has a distance; twice as many around it."""
    background_distance: Annotated[float, Between(1e-3, 1e6)] = 10.0
    """Distance of the background where no two photographs show it, metres."""


@dataclass(frozen=True)
class BodyImage:
    """The body as a camera sees it.

    Attributes:
        colour: learned colour of the visible surface, linear, zero where there is none.
        coverage: 1 where the body is, 0 elsewhere.
        depth: metres along the optical axis; infinite where there is none.
    """

    colour: Float[Tensor, "height width 3"]
    coverage: Float[Tensor, "height width"]
    depth: Float[Tensor, "height width"]


@dataclass(frozen=True)
class SkinChange:
    """Change of the body's colours, given at its vertices.

    The new colour is `lerp(factor * learned, instead, share)`.

    Attributes:
        factor: multiplies the learned colours.
        instead: linear colours that replace the learned ones.
        share: how far they replace them: 0 not at all, 1 completely.
    """

    factor: Float[Tensor, " vertex"]
    instead: Float[Tensor, "vertex 3"]
    share: Float[Tensor, " vertex"]


class Body(nn.Module):
    """A mesh with learned colours; a mesh without faces covers nothing.

    Attributes:
        atlas: where its faces lie in the texture of its colours; a mesh's own texture coordinates are not used.
    """

    vertices: Tensor
    faces: Tensor
    corner_uv: Tensor

    def __init__(self, mesh: Mesh, config: SurroundConfig) -> None:
        super().__init__()
        self.register_buffer("vertices", mesh.vertices.float().clone())
        self.register_buffer("faces", mesh.faces.clone())
        self.atlas = FaceAtlas.within(len(mesh.faces), config.body_texture, _edge_steps(mesh, config.body_texel))
        self.register_buffer("corner_uv", self.atlas.corner_uv().to(mesh.vertices.device), persistent=False)
        self.colour = nn.Parameter(torch.full((self.atlas.size, self.atlas.size, 3), START))

    @property
    def mesh(self) -> Mesh:
        """The mesh on which the colours are learned."""
        return Mesh(self.vertices, self.faces)

    def vertex_colours(self) -> Float[Tensor, "vertex 3"]:
        """Linear colours at the vertices, means over their faces; zero at vertices of no face."""
        corners, at_corners = self.faces.flatten(), sample_picture(self.colour, self.corner_uv.flatten(0, 1))
        total = self.colour.new_zeros(len(self.vertices), 3).index_add(0, corners, at_corners)
        return total / torch.bincount(corners, minlength=len(total)).clamp(min=1)[:, None]

    def draw(self, camera: Camera) -> TriangleBuffer:
        """Rasterise the mesh, its torso as it was when the camera took its photograph."""
        return rasterise_triangles(camera.posed(self.vertices), self.faces, camera)

    def forward(
        self, camera: Camera, seen: TriangleBuffer | None = None, change: SkinChange | None = None
    ) -> BodyImage:
        """Draw the body.

        Args:
            camera: the view.
            seen: the rasterised mesh, if the caller has it already.
            change: how the colours differ from the learned ones, if they do.
        """
        seen = seen or self.draw(camera)
        colour, covered = self.colours(seen, change=change), (seen.face >= 0).to(self.colour.dtype)
        return BodyImage(colour, covered, seen.depth)

    def colours(
        self, seen: TriangleBuffer, factor: int = 1, change: SkinChange | None = None
    ) -> Float[Tensor, "height width 3"]:
        """Linear colours of the visible surface; zero where there is none.

        Args:
            seen: the mesh, drawn at `factor` times the resolution of the colours.
            factor: pixels of the drawing for each pixel, along each axis; those with surface are averaged.
            change: how the colours differ from the learned ones, if they do.
        """
        changes = None
        if change is not None:
            changes = torch.cat([change.factor[:, None], change.share[:, None], change.instead], dim=1)
        return surface_colours(self.colour, self.corner_uv, seen, factor, changes)


def _edge_steps(mesh: Mesh, step: float) -> int:
    """Steps along a typical edge of a mesh."""
    corners = mesh.corners()
    lengths = (corners[:, 1] - corners[:, 0]).norm(dim=-1)
    return round(float(lengths.median()) / step) if len(lengths) else 1
