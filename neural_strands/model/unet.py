"""The image generator: maps splatted descriptors at several resolutions to hair colour and opacity.

Paper, section 4.3, "Image Generation". Design decisions:

- The descriptor map of each level joins the encoder at that level, so holes at full resolution are filled from below.
- Alias-free (the default): resampling by designed low-pass filters, activations filtered at twice the resolution. Plain
  (for the ablation): strided convolutions, nearest-neighbour upsampling and pointwise activations.
- No normalisation layer: a crop renders like the same pixels of the whole image, and shifted input gives shifted
  output.
- The output is a correction: colour starts from the shaded points and opacity from their coverage.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from neural_strands.foundation.configs import Between
from neural_strands.raster.filters import LowPass
from neural_strands.raster.resample import downsample, filtered_leaky_relu, leaky_relu, upsample


@dataclass(frozen=True)
class UNetConfig:
    """Size and kind of the image generator."""

    widths: Annotated[tuple[Annotated[int, Between(1, 512)], ...], Between(1, 8)] = (16, 32, 32)
    """Channels at each level, finest first; every level halves the resolution."""
    alias_free: bool = True
    """Filtered resampling and activations; otherwise strided convolutions and pointwise activations."""
    corrects: bool = True
    """Correct the splatted colours and the opacity of their coverage; otherwise these are the picture, and the network
    learns nothing (for the ablation)."""
    low_pass: LowPass = field(default_factory=LowPass)
    """The filter between neighbouring levels and around activations."""

    @property
    def levels(self) -> int:
        """Number of resolutions."""
        return len(self.widths)

    @property
    def stride(self) -> int:
        """Pixels of the finest level per pixel of the coarsest."""
        return 2 ** (self.levels - 1)


class Activated(nn.Module):
    """A 3 x 3 convolution and its activation."""

    kernel: Tensor

    def __init__(self, inputs: int, outputs: int, config: UNetConfig, generator: torch.Generator) -> None:
        super().__init__()
        self.alias_free = config.alias_free
        weight = torch.randn(outputs, inputs, 3, 3, generator=generator) / (9 * inputs) ** 0.5
        self.weight = nn.Parameter(weight.contiguous(memory_format=torch.channels_last))
        self.bias = nn.Parameter(torch.zeros(outputs))
        self.register_buffer("kernel", config.low_pass.coefficients(), persistent=False)

    def forward(
        self, images: Float[Tensor, "batch inputs height width"], stride: int = 1
    ) -> Float[Tensor, "batch outputs new_height new_width"]:
        """Convolve, add the bias, activate; on the CPU, images in bfloat16 return as float32."""
        if images.dtype == torch.bfloat16 and images.device.type == "cpu":
            linear = F.conv2d(images, self.weight.to(images.dtype), stride=stride, padding=1).float()
        else:
            linear = F.conv2d(images, self.weight, stride=stride, padding=1)
        return filtered_leaky_relu(linear, self.bias, self.kernel) if self.alias_free else leaky_relu(linear, self.bias)


class UNet(nn.Module):
    """Maps a descriptor pyramid to corrections of the hair's colour and of its opacity logit."""

    kernel: Tensor

    def __init__(self, inputs: int, config: UNetConfig, generator: torch.Generator) -> None:
        super().__init__()
        self.config = config
        widths = config.widths
        self.register_buffer("kernel", config.low_pass.coefficients(), persistent=False)
        self.encoders = nn.ModuleList(
            Activated(inputs + above, width, config, generator)
            for above, width in zip((0, *widths[:-1]), widths, strict=True)
        )
        self.strided = nn.ModuleList(
            Activated(width, width, config, generator) for width in (() if config.alias_free else widths[:-1])
        )
        self.decoders = nn.ModuleList(
            Activated(fine + coarse, fine, config, generator) for fine, coarse in pairwise(widths)
        )
        self.output = nn.Parameter(0.1 * torch.randn(4, widths[0], generator=generator) / widths[0] ** 0.5)
        self.bias = nn.Parameter(torch.zeros(4))

    def forward(self, pyramid: Sequence[Float[Tensor, "batch channel _ _"]]) -> Float[Tensor, "batch 4 height width"]:
        """Corrections of colour and opacity logit for every pixel of the finest map, which may have any size.

        Args:
            pyramid: descriptor maps, finest first, each side half of the previous one, rounded up. For maps in
                bfloat16, what convolutions of encoders and decoders read and return is rounded, and nothing else.

        Raises:
            ValueError: the number of maps or their sizes do not fit the network.
        """
        height, width = pyramid[0].shape[-2:]
        maps = self._padded(pyramid)
        hidden = self.encoders[0](maps[0])
        kept = [hidden]
        for level in range(1, self.config.levels):
            hidden = self.encoders[level](_joined(self._down(hidden, level - 1), maps[level], like=maps[0]))
            kept.append(hidden)
        for level in reversed(range(self.config.levels - 1)):
            hidden = self.decoders[level](_joined(kept[level], self._up(hidden), like=maps[0]))
        # In channels-last memory a 1 x 1 convolution is a matrix product, which is much faster on the CPU.
        image = F.linear(hidden.permute(0, 2, 3, 1), self.output, self.bias)
        return image.permute(0, 3, 1, 2)[..., :height, :width]

    def _down(self, images: Tensor, level: int) -> Tensor:
        return downsample(images, self.kernel) if self.config.alias_free else self.strided[level](images, stride=2)

    def _up(self, images: Tensor) -> Tensor:
        return upsample(images, self.kernel) if self.config.alias_free else F.interpolate(images, scale_factor=2.0)

    def _padded(self, pyramid: Sequence[Tensor]) -> list[Tensor]:
        """Pad with zeros at the right and the bottom, so that each level is exactly half the previous one.

        Raises:
            ValueError: the number of maps or their sizes do not fit the network.
        """
        stride, levels = self.config.stride, self.config.levels
        if len(pyramid) != levels:
            raise ValueError(f"this UNet reads {levels} descriptor maps, found {len(pyramid)}")
        sizes = [(-(-side // stride)) * stride for side in pyramid[0].shape[-2:]]
        padded = []
        for level, images in enumerate(pyramid):
            missing = [size // 2**level - side for size, side in zip(sizes, images.shape[-2:], strict=True)]
            if not all(0 <= side < stride for side in missing):
                raise ValueError(
                    f"map {level} has sides {tuple(images.shape[-2:])}; a finest map of "
                    f"{tuple(pyramid[0].shape[-2:])} needs each side halved {level} times"
                )
            grown = F.pad(images, (0, missing[1], 0, missing[0])) if any(missing) else images
            padded.append(grown.contiguous(memory_format=torch.channels_last))
        return padded


def _joined(
    one: Float[Tensor, "batch _ height width"], other: Float[Tensor, "batch _ height width"], like: Tensor
) -> Float[Tensor, "batch channel height width"]:
    """The channels of both, rounded to bfloat16 if `like` is."""
    if like.dtype == torch.bfloat16:
        return torch.cat([one.bfloat16(), other.bfloat16()], dim=1)
    return torch.cat([one, other], dim=1)
