"""A texture atlas without seams to unwrap: every face of a mesh gets texels of its own.

Two faces share a square block of texels, one in each corner of its diagonal. Between them lies a gap, so that bilinear
samples of one face never touch texels of the other.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

GAP = 3
"""Texels by which a block's side exceeds the steps along a face's edge."""


@dataclass(frozen=True)
class AtlasTexels:
    """The texels that samples of the faces touch.

    Attributes:
        texel: flat indices into the texture.
        face: the face of each.
        barycentric: where on that face it lies; texels beyond an edge count as on it.
    """

    texel: Int64[Tensor, " texel"]
    face: Int64[Tensor, " texel"]
    barycentric: Float[Tensor, "texel 3"]


@dataclass(frozen=True)
class FaceAtlas:
    """Where the faces of a mesh lie in their texture.

    Attributes:
        faces: number of faces.
        steps: texels from one corner of a face to the next.
    """

    faces: int
    steps: int

    @classmethod
    def within(cls, faces: int, size: int, most_steps: int) -> "FaceAtlas":
        """The atlas of the finest steps, but no more than `most_steps`, that fits into `size` texels a side.

        If none fits, the faces get one step for each edge, and the texture is larger.
        """
        return cls(faces, max(min(size // max(_blocks_a_side(faces), 1) - GAP, most_steps), 1))

    @property
    def block(self) -> int:
        """Side of the block that two faces share, texels."""
        return self.steps + GAP

    @property
    def size(self) -> int:
        """Side of the texture, texels; 1 if there are no faces."""
        return max(_blocks_a_side(self.faces) * self.block, 1)

    def corner_uv(self) -> Float[Tensor, "face 3 2"]:
        """Texture coordinates of the faces' corners, which lie at centres of texels."""
        near = torch.tensor([[0.0, 0.0], [self.steps, 0.0], [0.0, self.steps]])
        places = torch.stack([near, self.block - 1 - near])[torch.arange(self.faces) % 2]
        return (self._origins()[:, None] + places + 0.5) / self.size

    def texels(self) -> AtlasTexels:
        """The texels that belong to faces."""
        column, row = torch.meshgrid(*(2 * [torch.arange(self.steps + 2)]), indexing="xy")
        touched = column + row <= self.steps + 1
        near = torch.stack([column[touched], row[touched]], dim=-1)
        places = torch.stack([near, self.block - 1 - near])[torch.arange(self.faces) % 2]
        at = self._origins()[:, None].long() + places
        along = (near / self.steps).clamp(max=1)
        beyond = torch.cat([(1 - along.sum(dim=1, keepdim=True)).clamp(min=0), along], dim=1)
        share = beyond / beyond.sum(dim=1, keepdim=True)
        return AtlasTexels(
            (at[..., 1] * self.size + at[..., 0]).flatten(),
            torch.arange(self.faces).repeat_interleave(len(near)),
            share.repeat(self.faces, 1),
        )

    def _origins(self) -> Float[Tensor, "face 2"]:
        """Column and row of the first texel of each face's block."""
        block, side = torch.arange(self.faces) // 2, max(_blocks_a_side(self.faces), 1)
        return self.block * torch.stack([block % side, block // side], dim=-1).float()


def _blocks_a_side(faces: int) -> int:
    """Blocks along each side of a square that holds two faces a block."""
    return math.ceil(math.sqrt(math.ceil(faces / 2)))
