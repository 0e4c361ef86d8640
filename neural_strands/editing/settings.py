"""The settings of edits, shared by the command line, JSON and the viewer; nothing heavy is imported here."""

import math
from dataclasses import dataclass
from typing import Annotated

from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError

Place = Annotated[float, Between(-1000.0, 1000.0)]
"""A coordinate in world metres."""
Unit = Annotated[float, Between(-1000.0, 1000.0)]
"""A component of a direction, whose length does not matter."""
Dab = tuple[float, float, float]
"""A dab of a round brush on the scalp chart: u, v and radius, all in the chart's unit."""
Dabs = Annotated[tuple[Dab, ...], Between(0, 10_000)]
"""A painted region of the scalp."""
SHORTEST = 0.001
"""A strand that would become shorter than this is removed, metres."""
MOST_STRANDS = 150_000
"""Largest number of strands that can be grown."""
WAYS = ("length", "fraction", "plane", "box", "mesh")
"""The settings that determine where a haircut ends strands; exactly one of them is set."""


@dataclass(frozen=True)
class Haircut:
    """Cut strands to a length, by a share of their length, or where they leave a half-space, a box or a mesh.

    A strand is cut where it first leaves the shape, seen from its root; one whose root lies outside is removed.
    """

    length: Annotated[float, Between(SHORTEST, 10.0)] | None = None
    """Longest strand that remains, metres."""
    fraction: Annotated[float, Between(0.0, 1.0)] | None = None
    """Share of every strand that is cut off, from 0 to 1."""
    plane: tuple[Place, Place, Place, Place, Place, Place] | None = None
    """A point of a plane and its normal (x y z, metres): what lies on the side of the normal is cut."""
    box: tuple[Place, Place, Place, Place, Place, Place] | None = None
    """Two opposite corners of a box (x y z, metres): what lies outside is cut."""
    mesh: str | None = None
    """File of a closed mesh in world metres: what lies outside is cut."""
    uneven: Annotated[float, Between(0.0, 0.1)] = 0.003
    """Largest additional length that is cut off at random, metres, so that the edge looks cut by hand."""
    region: Dabs = ()
    """Dabs on the scalp chart (u, v, radius); without any, the whole scalp is cut."""
    seed: int = 0
    """Seed of the uneven edge."""

    def __post_init__(self) -> None:
        given = [name for name in WAYS if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f"haircut: expected one of {', '.join(WAYS)}, found {' and '.join(given) or 'none'}; give one."
            )
        if self.plane is not None and math.hypot(*self.plane[3:]) < 1e-6:
            raise InputError("haircut: expected a plane's normal with a length, found zeros; give a direction.")


@dataclass(frozen=True)
class Density:
    """Change the number of strands, which are decoded from the scalp textures at evenly spread roots."""

    strands: Annotated[int, Between(1, MOST_STRANDS)]
    """Number of strands, from 1 to 150,000."""
    seed: int = 0
    """Seed of the new roots."""


@dataclass(frozen=True)
class Restyle:
    """Change length, curl, wave and volume through the corresponding quantities of the strand prior."""

    length: Annotated[float, Between(0.1, 5.0)] = 1.0
    """Factor on the length of every strand."""
    curl: Annotated[float, Between(-1.0, 2.0)] = 0.0
    """Helical curls, from 0 (as it is) to 1 (curls of a centimetre) and beyond; -1 straightens."""
    wave: Annotated[float, Between(0.0, 2.0)] = 0.0
    """Flat waves, from 0 (as it is) to 1 and beyond."""
    volume: Annotated[float, Between(-1.0, 2.0)] = 0.0
    """How far strands stand off the scalp: 1 raises them by about 20 degrees, -1 lays them down as far."""
    region: Dabs = ()
    """Dabs on the scalp chart (u, v, radius); without any, the whole scalp changes."""
    seed: int = 0
    """Seed of the phases of curls and waves."""

    def __post_init__(self) -> None:
        if self.curl > 0 and self.wave > 0:
            raise InputError("restyle: expected curl or wave above 0, found both; give one.")


@dataclass(frozen=True)
class Blend:
    """Mix the shape of another run into this one; the appearance stays."""

    other: str
    """The other run, or the folder of its model."""
    share: Annotated[float, Between(0.0, 1.0)] = 0.5
    """Share of the other run, from 0 to 1."""
    region: Dabs = ()
    """Dabs on the scalp chart (u, v, radius); without any, the whole scalp changes."""


@dataclass(frozen=True)
class Transfer:
    """Give this head and appearance the shape of another run."""

    other: str
    """The other run, or the folder of its model."""


@dataclass(frozen=True)
class Sample:
    """Replace the hairstyle by a new one sampled from the strand prior; the appearance stays."""

    likeness: Annotated[float, Between(0.0, 1.0)] = 0.85
    """How much of the run's own hairstyle remains, from 0 (only the sample) to 1 (unchanged)."""
    variety: Annotated[float, Between(0.0, 2.0)] = 0.3
    """How much strands vary over the scalp, in standard deviations of the prior."""
    seed: int = 0
    """Seed of the hairstyle."""


@dataclass(frozen=True)
class Wind:
    """Let wind move the hair: gusts travel through it and bend strands, more so farther from the root.

    Strands keep their lengths and stay out of head and shoulders.
    """

    direction: tuple[Unit, Unit, Unit] = (1.0, 0.0, 0.0)
    """Direction towards which the wind blows (x y z; y is up, z out of the face)."""
    strength: Annotated[float, Between(0.0, 20.0)] = 1.0
    """Force of the wind over the weight of the hair: 1 lifts the tips of long hair by 45 degrees."""
    gusts: Annotated[float, Between(0.0, 1.0)] = 0.5
    """Strength of the gusts, from 0 (steady wind) to 1."""
    seconds: Annotated[float, Between(0.0, 600.0)] = 4.0
    """Duration, seconds; the wind rises during the first half second."""
    calm: Annotated[float, Between(0.0, 60.0)] = 0.0
    """Time without wind at the end, seconds, in which the hair comes to rest; the wind falls during its first half
    second."""
    fps: Annotated[float, Between(1.0, 240.0)] = 24.0
    """Frames per second."""
    seed: int = 0
    """Seed of the gusts."""
    simulate: bool = False
    """Simulate the hair as elastic rods, which swing and slide over head and shoulders, instead of the quick wind."""
    guides: Annotated[int, Between(1, 20_000)] = 500
    """Number of simulated strands; the others follow those around them."""

    def __post_init__(self) -> None:
        if math.hypot(*self.direction) < 1e-6:
            raise InputError("wind: expected a direction with a length, found zeros; give a direction.")

    @property
    def frames(self) -> int:
        """Number of frames."""
        return max(1, round((self.seconds + self.calm) * self.fps))


Edit = Haircut | Density | Restyle | Blend | Transfer | Sample | Wind
"""Union of all edits."""
KINDS: dict[str, type[Edit]] = {
    "haircut": Haircut,
    "density": Density,
    "restyle": Restyle,
    "blend": Blend,
    "transfer": Transfer,
    "sample": Sample,
    "wind": Wind,
}
"""The edits, by the name under which JSON and the command line know them."""
