"""The one way from a camera to pixels: a model, the strands that it shows, and the volume that shades them."""

from dataclasses import dataclass

import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel, RenderOutput
from neural_strands.model.hair_volume import HairVolume, hair_volume


@dataclass(frozen=True)
class HairRenderer:
    """Strands decoded once, or edited, that a model renders from any number of cameras; no gradient passes.

    A fit renders strands that move at every step, with gradients: it calls `HairModel.render` itself.

    Attributes:
        model: renders.
        strands: world metres, with `root_uv`.
        volume: density of these strands.

    Examples:
        >>> import neural_strands as ns
        >>> renderer = ns.HairRenderer.of(ns.load_model("run"))
        >>> cameras = ns.turntable_cameras(renderer.strands.points, count=2, size=(32, 24))
        >>> [tuple(renderer.render(camera).rgb.shape) for camera in cameras]
        [(24, 32, 3), (24, 32, 3)]
    """

    model: HairModel
    strands: Strands
    volume: HairVolume

    @classmethod
    @torch.no_grad()
    def of(cls, model: HairModel, strands: Strands | None = None) -> "HairRenderer":
        """Show a model's own strands, or given ones, such as edited strands.

        Args:
            model: renders.
            strands: world metres, with `root_uv`; by default those that the model decodes.

        Raises:
            ValueError: strands without `root_uv`.
        """
        strands = model.decode() if strands is None else strands
        if strands.root_uv is None:
            raise ValueError("strands to render need root_uv: it says where on the scalp their appearance is stored")
        return cls(model, strands, hair_volume(strands.points))

    def showing(self, strands: Strands) -> "HairRenderer":
        """The same model with other strands.

        Raises:
            ValueError: strands without `root_uv`.
        """
        return HairRenderer.of(self.model, strands)

    @torch.no_grad()
    def render(self, camera: Camera) -> RenderOutput:
        """One view, of any size."""
        return self.model.render(self.strands, camera, volume=self.volume)
