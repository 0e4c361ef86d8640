"""The whole representation: scalp textures -> strands -> descriptors -> image (paper, figure 2).

`decode` turns the shape texture into strands; `render` turns strands, wherever they come from, into an image. Static
hair is decoded once and rendered many times. Edited or ground-truth strands are rendered the same way; their appearance
is looked up at the position of their roots on the scalp chart.
"""

from dataclasses import dataclass, field, replace
from typing import Annotated

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn
from torch.nn import functional

from neural_strands.foundation.configs import Between
from neural_strands.foundation.devices.transfers import sent
from neural_strands.foundation.precision import has_bfloat16_matrices
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.frames import to_world
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.strands import Strands
from neural_strands.model.compositing import (
    between_lines,
    compose,
    filled_from_coarser,
    hair_rectangle,
    near_hair,
    surrounding_odds,
    weighted_gradient,
)
from neural_strands.model.grain import Grain
from neural_strands.model.hair_volume import HairVolume, hair_volume
from neural_strands.model.light import LightChange
from neural_strands.model.outputs import Drawing, HairImage, RenderOutput
from neural_strands.model.scalp_textures import ScalpTextureConfig, ScalpTextures
from neural_strands.model.seen_directions import Viewpoint, share_elsewhere, turn_to_seen
from neural_strands.model.shading import PointShading, ShadingConfig
from neural_strands.model.surround.background import Background
from neural_strands.model.surround.body import Body, SurroundConfig
from neural_strands.model.unet import UNet, UNetConfig
from neural_strands.model.view_functions import COUNT, in_basis, view_basis, view_functions
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.raster.nodes import visible_nodes
from neural_strands.raster.openings import openings
from neural_strands.raster.splat import SplatMap, splat_pyramid
from neural_strands.raster.visible import Room, VisiblePoints, interpolate_knots, visible_points
from neural_strands.scalp.roots import Roots

LEAST_OPACITY, MOST_OPACITY = 0.006, 0.95
"""Initial opacity of a pixel without any strand, and of a fully covered one that has little hair around it.

With a higher value for pixels without strands, a rim would show around the hair; with a lower one, gaps would hardly
learn to close."""
ODDS_SCALE = 0.2
"""Factor on the logit of coverage that the image generator sees, so that it is about as large as its other inputs."""


@dataclass(frozen=True)
class HairModelConfig:
    """Sizes and options of a hair model."""

    textures: ScalpTextureConfig = field(default_factory=ScalpTextureConfig)
    """The scalp textures."""
    unet: UNetConfig = field(default_factory=UNetConfig)
    """The image generator."""
    surround: SurroundConfig = field(default_factory=SurroundConfig)
    """Body and background."""
    shading: ShadingConfig = field(default_factory=ShadingConfig)
    """Colour of visible points."""
    lines: LineConfig = field(default_factory=LineConfig)
    """How strands are drawn; a fit to images with hair masks estimates their width itself."""
    points: Annotated[int, Between(2, 10000)] = 100
    """Points per strand."""
    supersample: Annotated[int, Between(1, 16)] = 3
    """Line pixels per image pixel along each axis; all of them are splatted into the image pixel."""
    mixed_precision: bool = True
    """Run the convolutions in bfloat16 on CUDA and, for pictures without gradients, on processors that multiply its
    matrices (AMX). Scores are always of pictures in float32."""

    @property
    def descriptor_channels(self) -> int:
        """Channels at every level of the pyramid: z_a, direction, t, viewing direction, colour, odds of coverage."""
        return self.textures.appearance_channels + 3 + 1 + 3 + 3 + 1


class HairModel(nn.Module):
    """Fitted hair of one head.

    Attributes:
        config: sizes and options.
        strand_width: width of the strands as drawn, metres: the config's until a fit estimates one; part of the state.
        seen_from: unit directions to the cameras of the photographs, empty before a fit; part of the state.
        view_mean, view_axes: `view_basis` of these directions, zero before a fit.
    """

    root_position: Tensor
    root_uv: Tensor
    root_frame: Tensor
    view_mean: Tensor
    view_axes: Tensor

    def __init__(
        self,
        config: HairModelConfig,
        roots: Roots,
        generator: StrandGenerator,
        body: Mesh,
        random: torch.Generator,
    ) -> None:
        """Start from a mean strand at every root.

        Args:
            config: sizes and options.
            roots: the strands' roots on the scalp.
            generator: the pre-trained strand generator, which stays frozen.
            body: head and body, which occlude the hair; may have no faces.
            random: draws the initial weights of the image generator.
        """
        super().__init__()
        self.config = config
        self.strand_width = config.lines.width
        self.seen_from = torch.zeros(0, 3)
        self.register_buffer("view_mean", torch.zeros(COUNT))
        self.register_buffer("view_axes", torch.zeros(COUNT, COUNT))
        self.register_buffer("root_position", roots.position.float().clone())
        self.register_buffer("root_uv", roots.uv.float().clone())
        self.register_buffer("root_frame", roots.frame.float().clone())
        self.textures = ScalpTextures(config.textures)
        self.generator = generator.requires_grad_(False)
        self.unet = UNet(config.descriptor_channels, config.unet, random)
        self.shading = PointShading(config.textures.appearance_channels, config.shading, random)
        self.grain = Grain()
        self.body = Body(body, config.surround)
        everything = torch.cat([roots.position, body.vertices]).float()
        centre = everything.mean(dim=0) if len(everything) else torch.zeros(3)
        self.background = Background(centre, config.surround)

    @property
    def lines(self) -> LineConfig:
        """How strands are drawn: the config, with the model's own strand width."""
        return replace(self.config.lines, width=self.strand_width)

    def get_extra_state(self) -> Tensor:
        """`[strand_width, tip of the config, *seen_from]`, as `state_dict` stores them."""
        numbers = torch.tensor([self.strand_width, self.config.lines.tip], dtype=torch.float64)
        return torch.cat([numbers, self.seen_from.double().flatten()])

    def set_extra_state(self, state: Tensor) -> None:
        """Restore `strand_width` and `seen_from` from a `state_dict`; the tip stays that of the config."""
        self.strand_width = state.tolist()[0]
        self.seen_from = state[2:].reshape(-1, 3).float().cpu()

    def forward(self, camera: Camera) -> RenderOutput:
        """Decode the strands and render them."""
        return self.render(self.decode(), camera)

    def decode(
        self, points: int | None = None, blur: float = 0.0, index: Int64[Tensor, " some"] | None = None
    ) -> Strands:
        """Strands of the roots, in world metres.

        Args:
            points: points per strand, by default the config's.
            blur: standard deviation, in texels, of the blur applied to the gradient of Z_g.
            index: the roots to decode, by default all.
        """
        roots = (self.root_position, self.root_uv, self.root_frame)
        position, uv, frame = roots if index is None else (values[index] for values in roots)
        local = self.generator(self.textures.sample_shape(uv, blur), points or self.config.points)
        return Strands(to_world(local, position, frame), root_uv=uv, root_normal=frame[:, :, 2])

    def draw(self, strands: Strands, camera: Camera) -> Drawing:
        """Rasterise strands and body for a camera."""
        factor = self.config.supersample
        camera = camera.to(self.root_uv.device)
        fine = camera.resized(camera.width * factor, camera.height * factor)
        body = self.body.draw(fine)
        return Drawing(body, rasterise_lines(strands.points, fine, body.depth, self.lines, strands.t))

    def render(
        self,
        strands: Strands,
        camera: Camera,
        blur: float = 0.0,
        volume: HairVolume | None = None,
        body_weight: Float[Tensor, "height width"] | None = None,
        light: LightChange | None = None,
        photographed: bool = False,
        room: Room | None = None,
    ) -> RenderOutput:
        """Render strands from one view.

        Args:
            strands: in world metres; `root_uv` is where on the scalp their appearance is looked up.
            camera: the view, of any size.
            blur: standard deviation, in texels, of the blur applied to the gradient of Z_a.
            volume: `hair_volume` of the strands, if the caller has it already; saves time when they are rendered
                repeatedly.
            body_weight: weight of the gradient that the body receives from each pixel; by default 1.
            light: how the light differs from that in which the appearance was fitted.
            photographed: whether a photograph was taken from there, so that neither directions nor appearance change
                (see `seen_directions`).
            room: number of visible points for which there is room (`visible_points`); by default, for all.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        hair = self.render_hair(strands, camera, blur, volume, light, photographed, room)
        camera, factor, alpha = camera.to(self.root_uv.device), self.config.supersample, hair.alpha
        seen, lines = hair.drawing
        between = openings(seen.depth, lines.segment, factor)
        body = self.body.colours(seen, factor, None if light is None else light.skin)
        share, skin = between_lines(body, between)
        if body_weight is not None:
            skin = weighted_gradient(skin, body_weight)
        behind = skin + (1 - share) * self.background(camera)
        rgb = to_srgb(compose(hair.rgb, alpha, behind))
        return RenderOutput(rgb, alpha, hair.rgb, behind, hair.coverage, lines, seen.depth, hair.visible.found)

    def with_grain(self, output: RenderOutput, random: torch.Generator, strength: float = 1.0) -> RenderOutput:
        """A rendered view with grain over its hair, as strong as that of the photographs.

        Args:
            output: what `render` returned.
            random: draws the grain; a generator on the CPU.
            strength: factor on the amplitude of the grain.
        """
        encoded = to_srgb(output.hair_rgb)
        hair = to_linear(encoded + strength * self.grain(encoded, random))
        return replace(output, rgb=to_srgb(compose(hair, output.alpha, output.behind_rgb)), hair_rgb=hair)

    def render_hair(
        self,
        strands: Strands,
        camera: Camera,
        blur: float = 0.0,
        volume: HairVolume | None = None,
        light: LightChange | None = None,
        photographed: bool = False,
        room: Room | None = None,
    ) -> HairImage:
        """Render the hair alone from one view; the arguments and errors are those of `render`."""
        # Computed before the camera moves to the device, so that the host need not wait for it.
        viewpoint = self.viewpoint(camera, photographed)
        camera = camera.to(self.root_uv.device)
        drawing = self.draw(strands, camera)
        visible = visible_points(drawing.lines, strands.points, self.config.supersample, strands.t, room)
        maps = self.splat_descriptors(strands, visible, camera, viewpoint, blur, volume, light)
        rgb, alpha = self._hair(maps, camera, viewpoint.turn).split([3, 1], dim=2)
        coverage = (maps[0].coverage / self.config.supersample**2).clamp(max=1.0)
        return HairImage(rgb, alpha[..., 0], coverage, drawing, visible)

    def splat_descriptors(
        self,
        strands: Strands,
        visible: VisiblePoints,
        camera: Camera,
        viewpoint: Viewpoint,
        blur: float = 0.0,
        volume: HairVolume | None = None,
        light: LightChange | None = None,
    ) -> list[SplatMap]:
        """Maps of the descriptor g = [z_a, d, t] of visible points, one per level (paper, "Neural Hair Descriptor").

        The last three channels are the colour of the points, linear.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        nodes = visible_nodes(visible, strands.points)
        world, direction = nodes.positions(strands.points), nodes.directions(strands.points)
        t = strands.parameters()[nodes.strand, nodes.vertex].to(direction)
        places, turn = strands.chart_positions(), viewpoint.turn
        knots = [
            self.textures.sample_appearance(places, blur, viewpoint.elsewhere),
            self.textures.sample_view_colour(places, viewpoint.functions),
        ]
        appearance, change = interpolate_knots(torch.cat(knots, dim=2), nodes.strand, t).split(
            [self.config.textures.appearance_channels, 3], dim=1
        )
        view = functional.normalize(world - camera.position, dim=1)
        around = (volume or hair_volume(strands.points)).at(world)
        if turn is not None:
            direction, view = direction @ turn.T, view @ turn.T
            around = torch.cat([around[:, :3] @ turn.T, around[:, 3:]], dim=1)
        fibre = torch.cat([direction, t[:, None]], dim=1)
        linear = to_linear(self.shading(appearance, fibre, view, around) + change)
        if light is not None:
            along = nodes.vertex / (strands.points_per_strand - 1)
            linear = linear * interpolate_knots(light.strands, nodes.strand, along)
        pixels, _ = camera.project(visible.world)
        descriptor = nodes.blend(torch.cat([appearance, fibre, linear], dim=1))
        size = (camera.height, camera.width)
        return splat_pyramid(pixels, descriptor, size, self.config.unet.levels, amounts=visible.weight)

    def _hair(
        self, maps: list[SplatMap], camera: Camera, turn: Float[Tensor, "3 3"] | None
    ) -> Float[Tensor, "height width 4"]:
        """Linear colour and opacity of the hair."""
        height, width = maps[0].coverage.shape
        part = Rectangle(0, 0, width, height)
        if maps[0].coverage.device.type == "cpu" and not torch.compiler.is_compiling():
            # Only what hair can reach; on a GPU the host would have to wait for the size of that rectangle.
            part = hair_rectangle(maps[0].coverage, self.config.unet.stride)
            maps = [level_map.cropped(part.reduced(2**level)) for level, level_map in enumerate(maps)]
            camera = camera.cropped(part.left, part.top, part.width, part.height)
        raw = self.generate(maps, camera, turn)
        coverage = maps[0].coverage / self.config.supersample**2
        start = torch.logit(coverage.clamp(LEAST_OPACITY, MOST_OPACITY)) + surrounding_odds(coverage)
        alpha = torch.sigmoid(raw[..., 3] + start) * near_hair(coverage.detach())
        return part.padded(torch.cat([to_linear(raw[..., :3]), alpha[..., None]], dim=2), height, width)

    def generate(
        self, maps: list[SplatMap], camera: Camera, turn: Float[Tensor, "3 3"] | None = None
    ) -> Float[Tensor, "height width 4"]:
        """Encoded colour and opacity logit of the hair, from splatted descriptors (paper, "Image Generation").

        Args:
            maps: the splatted maps of all levels, finest first.
            camera: the view.
            turn: `self.viewpoint(camera).turn`.
        """
        if not self.config.unet.corrects:
            return _uncorrected(maps)
        device = self.root_uv.device.type
        half = self.config.mixed_precision and device == "cuda"
        # On the CPU only where nothing is learned: a fit's gradients stay in float32.
        rounded = self.config.mixed_precision and device == "cpu" and not torch.is_grad_enabled()
        rounded = rounded and has_bfloat16_matrices()
        pyramid = []
        for level, level_map in enumerate(maps):
            parts = (*_encoded(level_map.features), *self._pixel_channels(level_map, camera, level, turn))
            # Channels-last memory, the fastest layout for convolutions.
            joined = torch.cat([part.bfloat16() if rounded else part for part in parts], dim=2)
            pyramid.append(joined.permute(2, 0, 1)[None])
        with torch.autocast(device, torch.bfloat16, enabled=half):
            raw = self.unet(pyramid)
        return raw[0].permute(1, 2, 0).float() + _uncorrected(maps)

    def _pixel_channels(
        self, level_map: SplatMap, camera: Camera, level: int, turn: Float[Tensor, "3 3"] | None
    ) -> tuple[Float[Tensor, "h w 3"], Float[Tensor, "h w 1"]]:
        """Viewing direction of every pixel of a level, and the scaled logit of the share that strands cover.

        Opacity in dense hair depends on the last few per cent of coverage, which only the logit tells apart.
        """
        share = level_map.coverage / (self.config.supersample * 2**level) ** 2
        rays = camera.ray_planes(2**level).permute(1, 2, 0)
        odds = ODDS_SCALE * torch.logit(share.clamp(LEAST_OPACITY, 1 - LEAST_OPACITY))
        return rays if turn is None else rays @ turn.T, odds[..., None]

    def viewpoint(self, camera: Camera, photographed: bool = False) -> Viewpoint:
        """Where a camera stands among the photographs.

        Args:
            camera: any camera.
            photographed: whether one of the photographs was taken from there.
        """
        device = self.root_uv.device
        if photographed or len(self.seen_from) == 0:
            # On the device, where the cameras of a fit are, so that the host need not wait for a position.
            direction = functional.normalize(camera.to(device).position - self.background.centre, dim=0)
            return Viewpoint(None, 0.0, in_basis(direction[None], self.view_mean, self.view_axes)[0])
        seen, place = self.seen_from, camera.position.cpu() - self.background.centre_on_cpu
        turn, elsewhere = turn_to_seen(place, seen), share_elsewhere(place, seen)
        direction = functional.normalize(place if turn is None else turn @ place, dim=0)
        functions = view_functions(direction[None], seen, elsewhere)[0]
        return Viewpoint(None if turn is None else sent(turn, device), elsewhere, sent(functions, device))

    def photographed_from(self, directions: Float[Tensor, "view 3"]) -> None:
        """Remember the unit directions to the cameras of the photographs, at least one."""
        self.seen_from = directions
        for buffer, values in zip((self.view_mean, self.view_axes), view_basis(directions), strict=True):
            buffer.copy_(values)


def _uncorrected(maps: list[SplatMap]) -> Float[Tensor, "height width 4"]:
    """The splatted colours, encoded, with gaps filled from coarser maps; and no change of the opacity's logit."""
    shaded = filled_from_coarser([level_map.features[-3:] for level_map in maps], [m.coverage for m in maps])
    return functional.pad(to_srgb(shaded.permute(1, 2, 0)), (0, 1))


def _encoded(features: Float[Tensor, "c h w"]) -> tuple[Float[Tensor, "h w descriptor"], Float[Tensor, "h w 3"]]:
    """Splatted descriptors, and colours sRGB-encoded: encoding gives dark hair more of the network's input range."""
    descriptor, colour = features.permute(1, 2, 0).split([len(features) - 3, 3], dim=2)
    # Neighbours in memory are encoded at once.
    return descriptor, to_srgb(colour.contiguous())
