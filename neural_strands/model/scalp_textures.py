"""The neural scalp textures: shape Z_g and appearance Z_a of every strand, by the position of its root (paper, 4.1)."""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.foundation.configs import Between
from neural_strands.model.view_functions import COUNT
from neural_strands.raster.texture import sample_texture


@dataclass(frozen=True)
class ScalpTextureConfig:
    """Sizes of the two textures."""

    shape_size: Annotated[int, Between(1, 8192)] = 256
    """Texels per side of the shape texture Z_g."""
    shape_channels: Annotated[int, Between(1, 1024)] = 64
    """Numbers per texel of Z_g: the latent size of the strand generator (D_g)."""
    appearance_size: Annotated[int, Between(1, 8192)] = 512
    """Texels per side of the appearance texture Z_a."""
    appearance_channels: Annotated[int, Between(1, 1024)] = 16
    """Numbers of the appearance descriptor z_a of a point (D_a)."""
    appearance_knots: Annotated[int, Between(1, 64)] = 1
    """Descriptors per texel of Z_a, evenly spaced from root to tip; points between two blend them. The paper has
    one."""


class ScalpTextures(nn.Module):
    """Z_g and Z_a; both start at zero, which decodes to the prior's mean strand and to one colour for all strands.

    Attributes:
        shape: Z_g.
        appearance: Z_a, as photographs show it.
        elsewhere: change of Z_a for cameras far from all photographs; zero until a fit ends.
        view: change of the encoded colour with each view function, at each knot; estimated in closed form, not
            learned. Without functions, colours do not change.
    """

    elsewhere: Tensor
    view: Tensor

    def __init__(self, config: ScalpTextureConfig) -> None:
        super().__init__()
        self.shape = nn.Parameter(torch.zeros(config.shape_size, config.shape_size, config.shape_channels))
        self.appearance = nn.Parameter(
            torch.zeros(
                config.appearance_size, config.appearance_size, config.appearance_knots * config.appearance_channels
            )
        )
        self.register_buffer("elsewhere", torch.zeros_like(self.appearance))
        size = config.appearance_size
        self.register_buffer("view", torch.zeros(0, size, size, config.appearance_knots * 3))
        self.knots = config.appearance_knots
        self.register_load_state_dict_pre_hook(_make_room)

    def change_with_view(self) -> None:
        """Make room for changes with each view function, zero until they are estimated."""
        self.view = self.view.new_zeros(COUNT, *self.view.shape[1:])

    def sample_shape(self, uv: Float[Tensor, "root 2"], blur: float = 0.0) -> Float[Tensor, "root latent"]:
        """Shape latents z_g at roots; `blur` (texels) spreads their gradient over neighbouring texels."""
        return sample_texture(self.shape, uv, blur)

    def sample_appearance(
        self, uv: Float[Tensor, "root 2"], blur: float = 0.0, elsewhere: float = 0.0
    ) -> Float[Tensor, "root knot feature"]:
        """Appearance features z_a at roots.

        Args:
            uv: on the scalp chart.
            blur: spreads the gradient over neighbouring texels, texels.
            elsewhere: how far the camera is from all photographs, from 0 to 1.
        """
        found = sample_texture(self.appearance, uv, blur)
        if elsewhere > 0:
            found = found + elsewhere * sample_texture(self.elsewhere, uv)
        return found.unflatten(1, (self.knots, -1))

    def sample_view_colour(
        self, uv: Float[Tensor, "root 2"], functions: Float[Tensor, " function"]
    ) -> Float[Tensor, "root knot 3"]:
        """Change of the encoded colour at roots in one view.

        Args:
            uv: on the scalp chart.
            functions: the view's functions (`model.view_functions`).
        """
        if len(self.view) == 0:
            return uv.new_zeros(len(uv), self.knots, 3)
        change = (functions @ self.view.flatten(1)).view(self.view.shape[1:])
        return sample_texture(change, uv).unflatten(1, (self.knots, 3))


def _make_room(textures: ScalpTextures, state: dict[str, Tensor], prefix: str, *_: object) -> None:
    """Give `view` the shape that it has in the state."""
    if (view := state.get(f"{prefix}view")) is not None:
        textures.view = textures.view.new_zeros(view.shape)
