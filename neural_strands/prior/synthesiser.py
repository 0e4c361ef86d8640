"""The sine layers of the strand generator (paper, "Strand Generator": a modulated SIREN).

A strand is integrated from dp/dt = length x [first(t) + second(t)], where t runs from the root (0) to the tip (1):

- first(t) = sum_i a_i sin(w_i t + b_i): carriers whose vector amplitudes a_i are modulated by the latent;
- second(t) = sum_j A_j sin((f + k_j) (t - 1/2) + warp(t) + b_j): units whose vector amplitude A_j, frequency f and
  phase are modulated by the latent; the carriers, weighted by the latent (`warp`), are added to their phase, as a first
  sine layer feeds a second.

The units of a strand differ from its own turn(t) = f (t - 1/2) + warp(t) by phases d_j(t) = k_j (t - 1/2) + b_j that
are the same for all strands. So sin(turn + d_j) = sin(turn) cos(d_j) + cos(turn) sin(d_j) needs one sine and one cosine
per step instead of one sine per unit, and the sums over units are products with fixed matrices (`FixedWaves`).

Letters: i carrier, j unit of the second layer.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.foundation.configs import Between
from neural_strands.prior.blocks import in_blocks

Output = Literal["gradient", "position"]
Modulation = Literal["all", "amplitude"]


@dataclass(frozen=True)
class SynthesiserConfig:
    """Sizes of the two sine layers."""

    carriers: Annotated[int, Between(1, 1024)] = 40
    """Sine units of the first layer."""
    smooth: Annotated[int, Between(1, 1024)] = 12
    """Functions of t per axis, mixed from the carriers and weighted by the latent."""
    sidebands: Annotated[int, Between(0, 256)] = 4
    """Pairs (sine, cosine) of second-layer units around the strand's own frequency."""
    warps: Annotated[int, Between(0, 1024)] = 1
    """Functions of t, mixed from the carriers, that the latent adds to the phase of the second layer."""
    slowest: float = 4.8
    """Lowest frequency of the second layer, cycles per strand."""
    fastest: float = 32.0
    """Highest frequency of the second layer, cycles per strand."""
    output: Output = "gradient"
    """Output of the sines: dp/dt, summed from the root (the paper), or positions directly (an ablation in the
    paper)."""
    modulation: Modulation = "all"
    """What the latent modulates in the second layer: amplitude, frequency and phase (the paper), or only the
    amplitude."""
    integration: Literal["exact", "euler"] = "exact"
    """How a step of t is integrated: exactly for each sine, or by its value in the middle of the step (forward
    Euler)."""

    @property
    def units(self) -> int:
        """Sine units of the second layer."""
        return 2 * self.sidebands


@dataclass(frozen=True)
class Modulations:
    """The synthesiser's input for each strand, from the modulator.

    Attributes:
        length: scale of the strand, metres.
        smooth: weights of the smooth functions (fixed mixes of the carriers), per axis, in strand lengths.
        unit_amplitude: amplitudes of the second layer, per axis, in strand lengths.
        frequency: frequency of the second layer, radians over t in [0, 1]; its units lie around it.
        warp: weight of each warp function in the phase of the second layer, radians.
    """

    length: Float[Tensor, " strand"]
    smooth: Float[Tensor, "strand 3 smooth"]
    unit_amplitude: Float[Tensor, "strand 3 unit"]
    frequency: Float[Tensor, " strand"]
    warp: Float[Tensor, "strand warp"]


@dataclass(frozen=True)
class FixedWaves:
    """Functions of t that all strands share, at each point; a point belongs to the step that leads to it.

    Attributes:
        smooth: the smooth functions, averaged over each step; 0 at the root, to which no step leads.
        turn: functions that add up to the turn of a strand: t - 1/2, weighted by its frequency, then the warps.
        unit: cosines, then sines of the units' own phases; 0 at the root.
    """

    smooth: Float[Tensor, "smooth point"]
    turn: Float[Tensor, "turn point"]
    unit: Float[Tensor, "unit 2*point"]


class Synthesiser(nn.Module):
    """Two sine layers over t, and their integration into a strand."""

    def __init__(self, config: SynthesiserConfig) -> None:
        super().__init__()
        self.config = config
        half = torch.arange(config.carriers)
        # Cosines of 0, 1, 2... half turns, then sines: together they can represent functions that differ at both ends.
        cosines = (3 * config.carriers + 4) // 5
        frequency = torch.where(half < cosines, half, half - cosines + 1) * math.pi
        self.carrier_frequency = nn.Parameter(frequency.float())
        self.carrier_phase = nn.Parameter(torch.where(half < cosines, math.pi / 2, 0.0))
        # The heading divides by the end of the first function (`reach`), so for positions it must not be the constant
        # carrier.
        first = 1 if config.output == "position" else 0
        self.smooth_mix = nn.Parameter(torch.eye(config.smooth, config.carriers).roll(first, dims=1))
        self.warp_mix = nn.Parameter(torch.eye(config.warps, config.carriers).roll(2, dims=1))
        offsets = math.pi * (torch.arange(config.sidebands) - (config.sidebands - 1) / 2)
        self.unit_frequency = nn.Parameter(offsets.repeat_interleave(2))
        self.unit_phase = nn.Parameter(torch.tensor([0.0, math.pi / 2]).repeat(config.sidebands))

    def forward(self, modulations: Modulations, points: int) -> Float[Tensor, "strand {points} 3"]:
        """Synthesise strands in local metres, the root at 0, in blocks that fit in the processor's cache."""
        waves = self.fixed_waves(points)

        def decode(smooth: Tensor, amplitude: Tensor, turn: Tensor) -> Float[Tensor, "block point 3"]:
            return positions(_offsets(smooth, amplitude, turn, waves), self.config.output)

        return in_blocks(decode, self._weights(modulations, points))

    def reference(self, modulations: Modulations, points: int) -> Float[Tensor, "strand {points} 3"]:
        """Add up the sines of all units as they are defined, for all strands at once; the naive twin of `forward`."""
        smooth, amplitude, _ = self._weights(modulations, points)
        t = self.times(points)
        warp = modulations.warp @ (self.warp_mix @ self.carriers(t, None))
        angle = self.unit_frequencies(modulations.frequency)[..., None] * (t - 0.5)
        waves = (angle + self.unit_phase[:, None] + warp[:, None]).sin()
        steps = smooth @ self.smooth_mix @ self.carriers(t, points) + amplitude @ waves
        return positions(_from_root(steps, self.config.output), self.config.output)

    def fixed_waves(self, points: int) -> FixedWaves:
        """What all strands of so many points share."""
        t = self.times(points)
        own = self.unit_frequencies(self.unit_frequency.new_zeros(1))[0, :, None] * (t - 0.5) + self.unit_phase[:, None]
        turn = torch.cat([(t - 0.5)[None], self.warp_mix @ self.carriers(t, None)])
        smooth, turn, cosines, sines = (
            _from_root(waves, self.config.output)
            for waves in (self.smooth_mix @ self.carriers(t, points), turn, own.cos(), own.sin())
        )
        return FixedWaves(smooth, turn, torch.cat([cosines, sines], dim=1))

    def unit_frequencies(self, frequency: Float[Tensor, " strand"]) -> Float[Tensor, "strand unit"]:
        """Frequency of each unit of strands, radians over t in [0, 1]."""
        units = self.unit_frequency
        if self.config.modulation == "amplitude":
            # Fixed frequencies above those of the smooth functions.
            units = units + math.pi * (torch.arange(len(units), device=units.device) // 2)
        return frequency[:, None] + units

    def times(self, points: int) -> Float[Tensor, " step"]:
        """Values of t at which strands of so many points are sampled."""
        return times(points, self.config.output, self.carrier_frequency)

    def _weights(self, modulations: Modulations, points: int) -> tuple[Tensor, Tensor, Tensor]:
        """The strands' weights of the smooth functions and of the units, metres per step, and of their turn."""
        scale = (modulations.length * self.step_size(points))[:, None, None]
        attenuation = self.attenuation(self.unit_frequencies(modulations.frequency), points)
        return (
            scale * modulations.smooth,
            scale * modulations.unit_amplitude * attenuation[:, None],
            torch.cat([modulations.frequency[:, None], modulations.warp], dim=1),
        )

    def step_size(self, points: int) -> float:
        """Length of a step in t (1 if the output is positions)."""
        return 1.0 / (points - 1) if self.config.output == "gradient" else 1.0

    def carriers(self, t: Float[Tensor, " step"], points: int | None) -> Float[Tensor, "carrier step"]:
        """The first layer at t, averaged over each step if `points` gives the length of the steps."""
        waves = (self.carrier_frequency[:, None] * t + self.carrier_phase[:, None]).sin()
        if points is None:
            return waves
        return waves * self.attenuation(self.carrier_frequency, points)[:, None]

    def reach(self) -> Float[Tensor, " smooth"]:
        """Integral of each smooth function over t; for positions, its change from root to tip."""
        if self.config.output == "position":
            ends = (self.carrier_frequency + self.carrier_phase).sin() - self.carrier_phase.sin()
        else:
            middle = (0.5 * self.carrier_frequency + self.carrier_phase).sin()
            ends = middle * torch.sinc(self.carrier_frequency / (2 * math.pi))
        return self.smooth_mix @ ends

    def attenuation(self, frequency: Float[Tensor, "*unit"], points: int) -> Float[Tensor, "*unit"]:
        """Mean of a sine over one step of t, divided by its value in the middle: sin(x)/x with x = frequency dt / 2."""
        if self.config.output == "position" or self.config.integration == "euler":
            return torch.ones_like(frequency)
        return torch.sinc(frequency / (2 * math.pi * (points - 1)))


def _offsets(
    smooth: Float[Tensor, "strand 3 smooth"],
    amplitude: Float[Tensor, "strand 3 unit"],
    turn: Float[Tensor, "strand turn"],
    waves: FixedWaves,
) -> Float[Tensor, "strand 3 point"]:
    """Offsets of points (or their positions) from the strands' weights (see `Synthesiser._weights`), metres."""
    angle = turn @ waves.turn
    cosines, sines = (amplitude @ waves.unit).chunk(2, dim=2)
    offsets = smooth @ waves.smooth
    return offsets.addcmul_(angle.sin()[:, None], cosines).addcmul_(angle.cos()[:, None], sines)


def _from_root(steps: Float[Tensor, "*rows step"], output: Output) -> Float[Tensor, "*rows point"]:
    """Begin with an offset of 0 at the root; positions have one already."""
    return steps if output == "position" else torch.nn.functional.pad(steps, (1, 0))


def times(points: int, output: Output, like: Tensor) -> Float[Tensor, " step"]:
    """Values of t at which the sines are sampled: the middle of each step (gradient) or each point (position)."""
    if output == "position":
        return torch.linspace(0, 1, points, dtype=like.dtype, device=like.device)
    return (torch.arange(points - 1, dtype=like.dtype, device=like.device) + 0.5) / (points - 1)


def positions(offsets: Float[Tensor, "strand 3 point"], output: Output) -> Float[Tensor, "strand point 3"]:
    """Sum offsets from the root (forward Euler, p_k = sum of d_i), or translate positions so that the root is at 0."""
    points = offsets - offsets[..., :1] if output == "position" else offsets.cumsum(dim=-1)
    return points.mT
