"""Hair as edits see it: strands, and the scalp texture that a model decodes to strands."""

from dataclasses import dataclass, replace
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.frames import to_world
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel
from neural_strands.model.thickness import strand_widths
from neural_strands.raster.texture import sample_texture

BODY_SPACING = 0.0025
"""Spacing of the grid of distances to head and body, metres: fine enough for ears."""


class Body:
    """Head and body, and the distance to them, which is sampled when it is first needed."""

    def __init__(self, mesh: Mesh) -> None:
        """Sample nothing yet."""
        self._mesh = mesh

    @cached_property
    def grid(self) -> SignedDistanceGrid | None:
        """Signed distance; None if there is no surface."""
        if not len(self._mesh.faces):
            return None
        # Strands only need exact distances where they touch the surface.
        return SignedDistanceGrid.build(self._mesh, BODY_SPACING, exact_within=BODY_SPACING)


@dataclass(frozen=True)
class Hair:
    """Hair to edit.

    Attributes:
        strands: world metres.
        model: the model that decoded the strands and renders them; None if there is only a groom.
        body: head and body, which strands must not enter; None if there is only a groom.
    """

    strands: Strands
    model: HairModel | None = None
    body: Body | None = None

    @classmethod
    def of(cls, model: HairModel) -> "Hair":
        """The hair of a model as it was fitted."""
        return cls(ScalpShape.of(model).decode(model), model, Body(model.body.mesh))

    @property
    def body_grid(self) -> SignedDistanceGrid | None:
        """Signed distance to head and body, shared by edited hair; None if there are none."""
        return None if self.body is None else self.body.grid

    def modelled(self, edit: str) -> HairModel:
        """The model, for an edit that needs one.

        Args:
            edit: name of the edit, for the error message.

        Raises:
            InputError: the hair is only a groom.
        """
        if self.model is None:
            raise InputError(
                f"{edit}: expected a fitted run with its model, found a groom alone; name the run instead."
            )
        return self.model


@dataclass(frozen=True)
class ScalpShape:
    """The shape texture Z_g, and the roots that sample it.

    Attributes:
        position: roots, world metres.
        uv: their positions on the scalp chart.
        frame: columns tangent, bitangent, normal.
        texture: latents of strands over the scalp chart.
    """

    position: Float[Tensor, "root 3"]
    uv: Float[Tensor, "root 2"]
    frame: Float[Tensor, "root 3 3"]
    texture: Float[Tensor, "row column latent"]

    @classmethod
    def of(cls, model: HairModel) -> "ScalpShape":
        """Roots and texture of a model as it was fitted."""
        return cls(model.root_position, model.root_uv, model.root_frame, model.textures.shape.detach())

    @torch.no_grad()
    def decode(self, model: HairModel) -> Strands:
        """Decode the strands, in world metres, with the widths that the model draws."""
        local = model.generator(sample_texture(self.texture, self.uv), model.config.points)
        strands = Strands(to_world(local, self.position, self.frame), self.uv, self.frame[:, :, 2])
        return replace(strands, width=strand_widths(model, strands))
