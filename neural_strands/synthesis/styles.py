"""Parameters of procedural grooms (lengths, waves, clumps, colour) and the named styles."""

from dataclasses import dataclass
from typing import Literal

StyleName = Literal["short", "straight", "wavy", "curly"]
HairColour = Literal["black", "brown", "auburn", "blond", "grey"]


@dataclass(frozen=True)
class Style:
    """A hair style on an adult head; lengths in metres, angles in radians."""

    length: float
    """Arc length of a strand at the crown (m)."""
    length_variation: float = 0.1
    """Standard deviation of the length between strands, as a share of it."""
    side_length: float = 1.0
    """Length at the lowest roots as a share of that at the crown."""
    tip_level: float | None = None
    """Distance of the blunt cut below the lowest root (m), below which no strand extends. None: no cut."""
    lift: float = 0.5
    """Slope of the first millimetres away from the scalp (0 along it, 1 at 45 degrees)."""
    gravity: float = 14.0
    """Curvature that bends a horizontal strand downwards (1/m)."""
    cling: float = 0.0
    """Curvature that bends a strand back to its layer where it leaves the head (1/m)."""
    thickness: float = 0.016
    """Height of the outermost layer above the skin (m)."""
    parting: float | None = 0.02
    """Distance of the parting from the middle, to the wearer's left (m). None: hair is combed away from the whorl."""
    whorl_turn: float = 1.25
    """Angle by which hair leaves the whorl sideways (rad)."""
    wave_amplitude: float = 0.0
    """Deviation of a wave from its axis (m)."""
    wave_length: float = 0.05
    """Length of one wave along its axis (m)."""
    helix: float = 0.25
    """Out-of-plane share of a wave: 0 is a flat wave, 1 a round coil."""
    clump_spacing: float = 0.012
    """Distance between neighbouring locks on the scalp (m)."""
    clump_strength: float = 0.55
    """How far the tips of strands move towards their lock (0 not at all, 1 all the way)."""
    frizz: float = 0.0012
    """Smooth random deviation of single strands (m)."""
    flyaways: float = 0.03
    """Share of strands that stand off from the rest."""


STYLES: dict[StyleName, Style] = {
    "short": Style(
        length=0.06,
        length_variation=0.16,
        side_length=0.5,
        lift=0.25,
        gravity=8.0,
        cling=15.0,
        thickness=0.016,
        parting=None,
        clump_spacing=0.011,
        clump_strength=0.7,
        frizz=0.0006,
        wave_amplitude=0.002,
        wave_length=0.06,
        flyaways=0.015,
    ),
    "straight": Style(
        length=0.42,
        length_variation=0.04,
        side_length=0.95,
        tip_level=0.08,
        lift=0.3,
        gravity=38.0,
        thickness=0.012,
        clump_spacing=0.016,
        clump_strength=0.5,
        frizz=0.0005,
        wave_amplitude=0.001,
        wave_length=0.15,
        flyaways=0.012,
    ),
    "wavy": Style(
        length=0.42,
        side_length=0.9,
        tip_level=0.075,
        lift=0.35,
        gravity=34.0,
        thickness=0.02,
        clump_spacing=0.022,
        clump_strength=0.85,
        wave_amplitude=0.01,
        wave_length=0.08,
        helix=0.5,
        frizz=0.0006,
        flyaways=0.015,
    ),
    "curly": Style(
        length=0.42,
        length_variation=0.12,
        side_length=0.85,
        tip_level=0.05,
        lift=0.6,
        gravity=28.0,
        thickness=0.028,
        clump_spacing=0.021,
        clump_strength=0.97,
        wave_amplitude=0.0085,
        wave_length=0.04,
        helix=1.0,
        frizz=0.0006,
        flyaways=0.02,
    ),
}


@dataclass(frozen=True)
class Melanin:
    """Pigment of a head of hair, in the concentrations of d'Eon et al. 2011, section 6.1."""

    eumelanin: float
    """Mean concentration of the brown-black pigment."""
    pheomelanin: float
    """Mean concentration of the yellow-red pigment."""
    variation: float = 0.25
    """Standard deviation of the logarithm of the concentration between strands."""


MELANIN: dict[HairColour, Melanin] = {
    "black": Melanin(1.8, 0.3, 0.15),
    "brown": Melanin(0.6, 0.3),
    "auburn": Melanin(0.16, 0.7),
    "blond": Melanin(0.07, 0.15, 0.35),
    "grey": Melanin(0.12, 0.02, 0.9),
}
