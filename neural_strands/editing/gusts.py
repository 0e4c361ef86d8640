"""Gusts: the strength of the wind at a place and time, for the quick and the simulated wind."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.settings import Wind
from neural_strands.foundation.smoothstep import smoothstep

RISE = 0.5
"""Time in which the wind rises, and in which it falls, seconds."""
SPEED = 0.8
"""Speed at which gusts cross the hair, metres per second."""
LONGEST_WAVE, SHORTEST_WAVE = 0.5, 0.06
"""Wavelengths of the largest and the smallest gusts, metres."""
WAVES = 6
"""Number of waves that make up the gusts; the swerves have as many."""
SWERVE = 0.25
"""Ratio of the sideways force to the force along the wind, at the strongest gusts."""


@dataclass(frozen=True)
class Gusts:
    """Waves that travel with the wind.

    Attributes:
        waves: wave vectors, radians per metre.
        speed: angular velocities, radians per second.
        phase: radians.
        size: amplitudes, whose squares add up to one half.
    """

    waves: Float[Tensor, "wave 3"]
    speed: Float[Tensor, " wave"]
    phase: Float[Tensor, " wave"]
    size: Float[Tensor, " wave"]

    @classmethod
    def drawn(cls, wind: Float[Tensor, "3"], random: torch.Generator) -> "Gusts":
        """Draw random waves, most of them along the wind; large slow ones are stronger than small fast ones."""
        share = torch.linspace(0, 1, WAVES)
        length = LONGEST_WAVE * (SHORTEST_WAVE / LONGEST_WAVE) ** share
        heading = wind.cpu() + 0.5 * torch.randn(WAVES, 3, generator=random)
        waves = torch.nn.functional.normalize(heading, dim=1) * (2 * math.pi / length)[:, None]
        size = length**0.5
        phase = 2 * math.pi * torch.rand(WAVES, generator=random)
        parts = (waves, SPEED * (waves @ wind.cpu()), phase, size / size.norm())
        return cls(*(part.to(wind) for part in parts))

    def at(
        self, places: Float[Tensor, "place 3"], seconds: Float[Tensor, "place moment"]
    ) -> Float[Tensor, "place moment"]:
        """Strength of the gusts at places and times, roughly within [-1, 1]."""
        angle = (places @ self.waves.T + self.phase)[:, None] - seconds[..., None] * self.speed
        return angle.sin() @ self.size


def blowing(wind: Wind, seconds: float) -> float:
    """Share of its full strength at which the wind blows at a time, without gusts."""
    falling = smoothstep(1 - (seconds - wind.seconds) / RISE) if wind.calm else 1.0
    return smoothstep(seconds / RISE) * falling


def sideways(direction: Float[Tensor, "3"]) -> Float[Tensor, "3"]:
    """The unit direction, perpendicular to the wind, in which it swerves."""
    side = torch.linalg.cross(direction, direction.roll(1) + 0.1)
    return torch.nn.functional.normalize(side, dim=0)


class WindField:
    """Ratio of the wind's force to the weight of the hair, at any place and time."""

    def __init__(self, wind: Wind, device: torch.device) -> None:
        """Draw the gusts.

        Args:
            wind: settings of the wind.
            device: device of the places.
        """
        random = torch.Generator().manual_seed(wind.seed)
        self.wind = wind
        self.direction = torch.nn.functional.normalize(torch.tensor(wind.direction, device=device), dim=0)
        self.gusts, self.swerves = (Gusts.drawn(self.direction, random) for _ in range(2))
        self.side = sideways(self.direction)

    def at(self, places: Float[Tensor, "*batch 3"], seconds: float) -> Float[Tensor, "*batch 3"]:
        """The force over the weight: a vector along the wind, except for swerves."""
        flat = places.reshape(-1, 3)
        gust, swerve = self.gust_and_swerve(flat, flat.new_full((len(flat), 1), seconds))
        return (self.force(seconds) * gust * self.towards(swerve)).reshape(places.shape)

    def force(self, seconds: float) -> float:
        """Force over weight at a time, without gusts."""
        return self.wind.strength * blowing(self.wind, seconds)

    def gust_and_swerve(
        self, places: Float[Tensor, "place 3"], seconds: Float[Tensor, "place moment"]
    ) -> tuple[Float[Tensor, "place moment"], Float[Tensor, "place moment"]]:
        """Factor on the force, and the ratio of sideways to forward force, at places and times."""
        gust = (1 + self.wind.gusts * self.gusts.at(places, seconds)).clamp(min=0.0)
        return gust, SWERVE * self.wind.gusts * self.swerves.at(places, seconds)

    def towards(self, swerve: Float[Tensor, "place 1"]) -> Float[Tensor, "place 3"]:
        """Unit directions of the swerving wind."""
        return torch.nn.functional.normalize(self.direction + swerve * self.side, dim=1)
