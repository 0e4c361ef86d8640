"""The strand generator: decodes a latent vector to a strand (paper, "Strand Generator").

The modulator maps the latent to 64 interpretable raw quantities (length, gain and frequency of the curl, chirp,
amplitudes of both sine layers), which determine amplitude, frequency and phase of the synthesiser's sines.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.foundation.configs import Between
from neural_strands.prior.bounded_quantities import length_from_raw, quantity_between
from neural_strands.prior.heading import smooth_from_heading
from neural_strands.prior.modulator import CouplingModulator, MlpModulator
from neural_strands.prior.synthesiser import Modulations, Synthesiser, SynthesiserConfig

LARGEST_GAIN = 1.0
"""Bound of the root mean square of the second layer's amplitudes, in strand lengths."""


@dataclass(frozen=True)
class GeneratorConfig:
    """Sizes of the generator."""

    latent: Annotated[int, Between(1, 512)] = 64
    """Numbers per strand (D_g in the paper)."""
    modulator: Literal["coupling", "mlp"] = "coupling"
    """Invertible coupling layers, or the paper's MLP."""
    hidden: Annotated[int, Between(1, 512)] = 64
    """Width of the modulator's networks."""
    layers: Annotated[int, Between(0, 64)] = 8
    """Coupling layers, or layers of the MLP."""
    synthesiser: SynthesiserConfig = field(default_factory=SynthesiserConfig)
    """The sine layers."""


@dataclass(frozen=True)
class Raw:
    """Output of the modulator: unbounded numbers.

    Attributes:
        length: see `bounded_quantities.length_from_raw`; roughly the logit of its logarithm between its bounds.
        gain: logit of the second layer's amplitude.
        frequency: logit of the logarithm of the curl's frequency between its bounds.
        warp: chirp of the curl, radians.
        unit: direction and phase of the curl (root mean square near 1).
        smooth: heading of the strand (first column, see `prior.heading`), then the weights of the other smooth
            functions on each axis, in strand lengths.
    """

    length: Float[Tensor, " strand"]
    gain: Float[Tensor, " strand"]
    frequency: Float[Tensor, " strand"]
    warp: Float[Tensor, "strand warp"]
    unit: Float[Tensor, "strand 3 unit"]
    smooth: Float[Tensor, "strand 3 smooth"]

    def flat(self) -> Float[Tensor, "strand raw"]:
        """All quantities concatenated, in the order of the attributes."""
        head = torch.stack([self.length, self.gain, self.frequency], dim=1)
        return torch.cat([head, self.warp, self.unit.flatten(1), self.smooth.flatten(1)], dim=1)


def raw_size(config: SynthesiserConfig) -> int:
    """Number of raw quantities of a strand."""
    return 3 + config.warps + 3 * config.units + 3 * config.smooth


class StrandGenerator(nn.Module):
    """Decodes latents into strands in their roots' frames (metres, the root at 0)."""

    def __init__(self, config: GeneratorConfig | None = None) -> None:
        super().__init__()
        self.config = config or GeneratorConfig()
        inner = self.config.synthesiser
        build = CouplingModulator if self.config.modulator == "coupling" else MlpModulator
        self.modulator = build(self.config.latent, self.config.hidden, self.config.layers)
        self.linear = nn.Linear(self.config.latent, raw_size(inner))
        self.synthesiser = Synthesiser(inner)

    def forward(self, latent: Float[Tensor, "strand latent"], points: int = 100) -> Float[Tensor, "strand {points} 3"]:
        """Decode strands with `points` points each, coordinate by coordinate in memory.

        Raises:
            ValueError: the latents have another size, or `points` is less than two.
        """
        self._check(latent, points)
        return self.synthesiser(self.modulations(self.raw(latent)), points)

    def reference(
        self, latent: Float[Tensor, "strand latent"], points: int = 100
    ) -> Float[Tensor, "strand {points} 3"]:
        """Decode all strands at once, sine by sine; tests compare `forward` with this."""
        return self.synthesiser.reference(self.modulations(self.raw(latent)), points)

    def raw(self, latent: Float[Tensor, "strand latent"]) -> Raw:
        """Apply the modulator and its linear map."""
        return self.split(self.linear(self.modulator(latent)))

    def split(self, flat: Float[Tensor, "strand raw"]) -> Raw:
        """Inverse of `Raw.flat`."""
        inner = self.config.synthesiser
        sizes = [1, 1, 1, inner.warps, 3 * inner.units, 3 * inner.smooth]
        length, gain, frequency, warp, unit, smooth = flat.split(sizes, dim=1)
        return Raw(
            length[:, 0],
            gain[:, 0],
            frequency[:, 0],
            warp,
            unit.unflatten(1, (3, inner.units)),
            smooth.unflatten(1, (3, inner.smooth)),
        )

    def latent(
        self, raw: Float[Tensor, "strand raw"]
    ) -> tuple[Float[Tensor, "strand latent"], Float[Tensor, " strand"]]:
        """Inverse of `raw` (from `Raw.flat`), and its log volume change up to the constant of the linear map.

        Raises:
            ValueError: the modulator is the paper's MLP, which has no inverse.
        """
        if not isinstance(self.modulator, CouplingModulator):
            raise ValueError("only a generator with a coupling modulator can be inverted")
        white = torch.linalg.solve(self.linear.weight, (raw - self.linear.bias).T).T
        return self.modulator.inverse(white)

    def modulations(self, raw: Raw) -> Modulations:
        """Amplitudes, frequencies and phases of the sine layers."""
        lowest, highest = self.frequency_bounds()
        if self.config.synthesiser.modulation == "all":
            frequency, warp = quantity_between(raw.frequency, lowest, highest), raw.warp
        else:
            frequency, warp = torch.full_like(raw.frequency, lowest), torch.zeros_like(raw.warp)
        gain = LARGEST_GAIN * raw.gain.sigmoid()
        smooth = smooth_from_heading(raw.smooth, self.synthesiser.reach())
        return Modulations(length_from_raw(raw.length), smooth, gain[:, None, None] * raw.unit, frequency, warp)

    def frequency_bounds(self) -> tuple[float, float]:
        """Lowest and highest curl frequency, radians over a strand."""
        inner = self.config.synthesiser
        return 2 * torch.pi * inner.slowest, 2 * torch.pi * inner.fastest

    def _check(self, latent: Tensor, points: int) -> None:
        if latent.ndim != 2 or latent.shape[1] != self.config.latent:
            raise ValueError(f"latent must be (strand, {self.config.latent}), found {tuple(latent.shape)}")
        if points < 2:
            raise ValueError(f"a strand needs at least two points, found {points}")
