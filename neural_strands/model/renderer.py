"""Renders finished strands from any camera: a model, the strands that it shows, and the volume that shades them."""

from dataclasses import dataclass, field
from functools import cached_property

import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.model.frame_memory import check_frame_memory
from neural_strands.model.hair_model import HairModel
from neural_strands.model.hair_volume import HairVolume, hair_volume
from neural_strands.model.light import BakedLight, LightChange
from neural_strands.model.outputs import HairImage, RenderOutput
from neural_strands.model.part_room import PartRoom
from neural_strands.model.thickness import strand_widths


@dataclass(frozen=True)
class HairRenderer:
    """Strands, fitted or edited, that a model renders from any number of cameras, without gradients.

    A fit renders strands that change at every step, with gradients, through `HairModel.render`.

    Attributes:
        model: the model that renders.
        strands: world metres, with `root_uv`.
        volume: density of these strands.
        fitted: for edited hair, the renderer of the hair on which the appearance was fitted; else None.
        light: for edited hair, the change of its light; else None.
        each: number of fitted strands that each strand stands for.
        room: for the visible parts of strands of a frame on a GPU.

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
    fitted: "HairRenderer | None" = None
    light: LightChange | None = None
    each: float = 1.0
    room: PartRoom = field(default_factory=PartRoom, repr=False, compare=False)

    @classmethod
    @torch.no_grad()
    def of(cls, model: HairModel, strands: Strands | None = None) -> "HairRenderer":
        """Build a renderer of a model's own strands, or of other strands on which its appearance was fitted.

        Args:
            model: the model that renders.
            strands: world metres, with `root_uv`; by default those that the model decodes.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        strands = model.decode() if strands is None else strands
        strands.chart_positions()  # Raises here rather than at the first frame.
        return cls(model, strands, hair_volume(strands.points))

    @torch.no_grad()
    def showing(self, strands: Strands, each: float | None = None) -> "HairRenderer":
        """Return a renderer of edited strands, relit for the light that reaches them now.

        Args:
            strands: world metres, with `root_uv`.
            each: number of fitted strands that each of them stands for; None: as many as the present ones.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        fitted = self.fitted or self
        if strands.points is fitted.strands.points:
            return fitted
        each = self.each if each is None else each
        volume = hair_volume(strands.points, fitted.volume.grid, each)
        light = fitted._baked.changed(strands, volume)
        return HairRenderer(self.model, strands, volume, fitted, light, each, self.room)

    @torch.no_grad()
    def prepare_edits(self) -> None:
        """Compute the light on the fitted hair now, so that the first edit need not wait for it."""
        _ = (self.fitted or self)._baked

    @torch.no_grad()
    def render(self, camera: Camera) -> RenderOutput:
        """Render one view, of any size that fits into memory.

        Raises:
            InputError: it does not fit.
        """
        check_frame_memory(self.strands, camera, self.model.config.supersample)
        return self.room.rendered(
            lambda room: self.model.render(self.strands, camera, volume=self.volume, light=self.light, room=room),
            camera.width * camera.height,
            self.strands.points.device,
        )

    @torch.no_grad()
    def with_grain(self, output: RenderOutput, strength: float = 1.0, seed: int = 0) -> RenderOutput:
        """A rendered view with the photographs' grain over its hair.

        Args:
            output: what `render` returned.
            strength: factor on the amplitude of the grain.
            seed: of the noise, which is the same on every device; frames of a video need seeds of their own.
        """
        return self.model.with_grain(output, torch.Generator().manual_seed(seed), strength)

    @torch.no_grad()
    def render_hair(self, camera: Camera) -> HairImage:
        """Render the hair alone, without what lies behind it.

        Raises:
            InputError: the view does not fit into memory.
        """
        check_frame_memory(self.strands, camera, self.model.config.supersample)
        return self.model.render_hair(self.strands, camera, volume=self.volume, light=self.light)

    @cached_property
    def _baked(self) -> BakedLight:
        """The light that reaches these strands, computed once."""
        width = float(strand_widths(self.model, self.strands).mean())
        body = self.model.body
        return BakedLight.of(self.strands, self.volume, width, body.mesh, body.vertex_colours())
