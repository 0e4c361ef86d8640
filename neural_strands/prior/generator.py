"""The strand generator: a latent vector to a strand (paper, "Strand Generator").

The modulator is an MLP with a linear skip. The skip alone turns the 64 numbers into 64 raw quantities with a meaning
(length, curl gain, curl frequency, chirp, amplitudes); the MLP adds what is not linear. The skip is chosen so that
latents of the training curves have zero mean and unit covariance: see `prior.whiten`.
"""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.prior.fast import synthesise
from neural_strands.prior.synthesiser import Modulations, Synthesiser, SynthesiserConfig

SHORTEST, LONGEST = 0.003, 2.0
"""Strand lengths (metres) that the generator reaches; training covers 0.01 to 0.60."""
LARGEST_GAIN = 0.6
"""Bound of the root mean square of the second layer's amplitudes, in strand lengths."""


@dataclass(frozen=True)
class GeneratorConfig:
    """Sizes of the generator."""

    latent: int = 64
    """Numbers a strand (D_g in the paper)."""
    hidden: int = 64
    """Width of the modulator's MLP."""
    layers: int = 2
    """Hidden layers of the modulator's MLP; the latent is fed to each of them."""
    synthesiser: SynthesiserConfig = field(default_factory=SynthesiserConfig)
    """The sine layers."""


@dataclass(frozen=True)
class Raw:
    """The quantities that the skip gives: unbounded numbers.

    Attributes:
        length: logit of the logarithm of the length between its bounds.
        gain: logit of the second layer's amplitude.
        frequency: logit of the logarithm of the curl's frequency between its bounds.
        warp: chirp of the curl, radians.
        unit: direction and phase of the curl (root mean square near 1).
        smooth: weights of the smooth functions, in strand lengths.
    """

    length: Float[Tensor, " strand"]
    gain: Float[Tensor, " strand"]
    frequency: Float[Tensor, " strand"]
    warp: Float[Tensor, "strand warp"]
    unit: Float[Tensor, "strand 3 unit"]
    smooth: Float[Tensor, "strand 3 smooth"]

    def flat(self) -> Float[Tensor, "strand raw"]:
        """All quantities side by side, in the order of the attributes."""
        head = torch.stack([self.length, self.gain, self.frequency], dim=1)
        return torch.cat([head, self.warp, self.unit.flatten(1), self.smooth.flatten(1)], dim=1)


class StrandGenerator(nn.Module):
    """Decodes latents into strands in their roots' frames (metres, the root at 0)."""

    def __init__(self, config: GeneratorConfig | None = None) -> None:
        super().__init__()
        self.config = config or GeneratorConfig()
        inner = self.config.synthesiser
        self.raw_size = 3 + inner.warps + 3 * inner.units + 3 * inner.smooth
        latent, hidden = self.config.latent, self.config.hidden
        self.skip = nn.Linear(latent, self.raw_size)
        self.modulator = nn.ModuleList(
            nn.Linear(latent if layer == 0 else hidden + latent, hidden) for layer in range(self.config.layers)
        )
        self.extra = nn.Linear(hidden, 3 * inner.carriers + 5 * inner.units + inner.warps)
        nn.init.zeros_(self.extra.weight)
        nn.init.zeros_(self.extra.bias)
        self.synthesiser = Synthesiser(inner)

    def forward(self, latent: Float[Tensor, "strand latent"], points: int = 100) -> Float[Tensor, "strand {points} 3"]:
        """Decode strands to `points` points each, by the fast path.

        Raises:
            ValueError: a latent of another size, or fewer than two points.
        """
        self._check(latent, points)
        return synthesise(self.synthesiser, self.modulations(latent), points)

    def reference(
        self, latent: Float[Tensor, "strand latent"], points: int = 100
    ) -> Float[Tensor, "strand {points} 3"]:
        """The same strands by the plain path, to which the fast one is held."""
        self._check(latent, points)
        return self.synthesiser(self.modulations(latent), points)

    def raw(self, latent: Float[Tensor, "strand latent"]) -> Raw:
        """The linear skip: quantities with a meaning."""
        inner = self.config.synthesiser
        sizes = [1, 1, 1, inner.warps, 3 * inner.units, 3 * inner.smooth]
        length, gain, frequency, warp, unit, smooth = self.skip(latent).split(sizes, dim=1)
        return Raw(
            length[:, 0],
            gain[:, 0],
            frequency[:, 0],
            warp,
            unit.unflatten(1, (3, inner.units)),
            smooth.unflatten(1, (3, inner.smooth)),
        )

    def modulations(self, latent: Float[Tensor, "strand latent"]) -> Modulations:
        """Amplitudes, frequencies and phases of the sine layers: the skip's, plus what the MLP adds."""
        inner = self.config.synthesiser
        raw = self.raw(latent)
        extra = self.extra(self._hidden(latent))
        sizes = [3 * inner.carriers, 3 * inner.units, inner.units, inner.units, inner.warps]
        carrier, unit, frequency, phase, warp = extra.split(sizes, dim=1)
        synthesiser = self.synthesiser
        if inner.modulation == "all":
            centre = between(raw.frequency, *self.frequency_bounds())[:, None]
            frequency = centre + synthesiser.unit_frequency + frequency
            phase = synthesiser.unit_phase + phase
            warp = raw.warp + warp
        else:
            frequency = self.fixed_frequencies().expand_as(frequency)
            phase = synthesiser.unit_phase.expand_as(phase)
            warp = torch.zeros_like(warp)
        gain = LARGEST_GAIN * raw.gain.sigmoid()
        return Modulations(
            between(raw.length, SHORTEST, LONGEST),
            raw.smooth @ synthesiser.smooth_mix + carrier.unflatten(1, (3, inner.carriers)),
            gain[:, None, None] * (raw.unit + unit.unflatten(1, (3, inner.units))),
            frequency,
            phase,
            warp,
        )

    def frequency_bounds(self) -> tuple[float, float]:
        """Lowest and highest curl frequency, radians over a strand."""
        inner = self.config.synthesiser
        return 2 * torch.pi * inner.slowest, 2 * torch.pi * inner.fastest

    def fixed_frequencies(self) -> Float[Tensor, " unit"]:
        """Frequencies of the second layer when only amplitudes are modulated: spread above the smooth functions."""
        spread = torch.arange(self.config.synthesiser.units, device=self.skip.weight.device) // 2
        return self.frequency_bounds()[0] + self.synthesiser.unit_frequency + spread * torch.pi

    def _hidden(self, latent: Float[Tensor, "strand latent"]) -> Float[Tensor, "strand hidden"]:
        hidden = latent
        for index, layer in enumerate(self.modulator):
            taken = latent if index == 0 else torch.cat([hidden, latent], dim=1)
            hidden = torch.nn.functional.silu(layer(taken))
        return hidden

    def _check(self, latent: Tensor, points: int) -> None:
        if latent.shape[1] != self.config.latent:
            raise ValueError(f"latent must be (strand, {self.config.latent}), got {tuple(latent.shape)}")
        if points < 2:
            raise ValueError(f"a strand needs at least two points, got {points}")


def between(logit: Float[Tensor, " strand"], low: float, high: float) -> Float[Tensor, " strand"]:
    """Squash a logit to a positive quantity between two bounds, even in its logarithm."""
    return low * (high / low) ** logit.sigmoid()


def logit_between(value: Float[Tensor, " strand"], low: float, high: float) -> Float[Tensor, " strand"]:
    """Inverse of `between`; values outside are taken at the bound."""
    share = torch.log(value.clamp(min=1e-12) / low) / torch.log(torch.tensor(high / low))
    return torch.logit(share, eps=1e-4)
