"""The encoder: maps a strand to mean and deviation of its latent (paper, "Training / Strand Generator": a 1D CNN).

The mean comes from the closed-form analysis (`prior.analysis`), which finds the curl's frequency by search and every
amplitude by least squares, to within a tenth of a millimetre. The 1D CNN predicts the deviation. With `analysis` off,
the CNN predicts both, as in the paper.
"""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.foundation.configs import Between
from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.analysis import analyse
from neural_strands.prior.bounded_quantities import LONGEST, SHORTEST, logit_between
from neural_strands.prior.generator import StrandGenerator


@dataclass(frozen=True)
class EncoderConfig:
    """Sizes of the encoder."""

    points: Annotated[int, Between(2, 512)] = 100
    """Points per strand that the CNN reads."""
    widths: Annotated[tuple[Annotated[int, Between(1, 512)], ...], Between(1, 8)] = (16, 24, 32, 48, 64)
    """Channels of the strided convolutions."""
    hidden: Annotated[int, Between(1, 512)] = 128
    """Width of the layer before the heads."""
    analysis: bool = True
    """Whether the mean is the closed-form analysis, or comes from the CNN (the paper)."""
    refine: Annotated[int, Between(0, 100)] = 1
    """Gauss-Newton steps of the analysis."""
    start_log_std: float = -4.0
    """Logarithm of the standard deviation before training."""


class StrandEncoder(nn.Module):
    """Maps strands in their roots' frames to mean and log standard deviation of their latents."""

    def __init__(self, generator: StrandGenerator, config: EncoderConfig | None = None) -> None:
        super().__init__()
        self.config = config or EncoderConfig()
        # The tuple hides the generator from torch, so that its weights are neither saved nor trained with the encoder.
        self._generator = (generator,)
        channels, length = 7, self.config.points - 1
        layers: list[nn.Module] = []
        for width in self.config.widths:
            layers += [nn.Conv1d(channels, width, kernel_size=4, stride=2, padding=1), nn.SiLU()]
            channels, length = width, (length - 2) // 2 + 1
        self.trunk = nn.Sequential(*layers, nn.Flatten(), nn.Linear(channels * length, self.config.hidden), nn.SiLU())
        self.mean = nn.Linear(self.config.hidden, generator.config.latent)
        self.log_std = nn.Linear(self.config.hidden, generator.config.latent)
        for head in (self.mean, self.log_std):
            nn.init.zeros_(head.weight)
            nn.init.zeros_(head.bias)

    def forward(
        self, points: Float[Tensor, "strand point 3"]
    ) -> tuple[Float[Tensor, "strand latent"], Float[Tensor, "strand latent"]]:
        """Mean and log standard deviation of each strand's latent; strands are in local metres with the root at 0.

        Raises:
            ValueError: the strands do not have the number of points that the encoder was built for.
        """
        if points.shape[1] != self.config.points:
            raise ValueError(f"strands must have {self.config.points} points, found {points.shape[1]}")
        hidden = self.trunk(self.features(points))
        mean = self.analysed(points) if self.config.analysis else self.mean(hidden)
        return mean, self.config.start_log_std + self.log_std(hidden)

    def analysed(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand latent"]:
        """Latents by closed-form analysis; gradients reach the modulator, but do not pass through the analysis."""
        (generator,) = self._generator
        return generator.latent(analyse(generator, points, self.config.refine).flat())[0]

    def features(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand channel step"]:
        """Position and direction at each step, both independent of scale, and the logarithm of the strand's length."""
        length = lengths(points)
        offsets = segments(points)
        middle = (points[:, 1:] + points[:, :-1]) / 2
        direction = torch.nn.functional.normalize(offsets, dim=-1)
        size = 0.2 * logit_between(length, SHORTEST, LONGEST)[:, None, None].expand(-1, offsets.shape[1], 1)
        return torch.cat([3 * middle / length[:, None, None], direction, size], dim=-1).transpose(1, 2)
