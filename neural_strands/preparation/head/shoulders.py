"""Neck and shoulders: few numbers that change them smoothly, and those that make the template a mean adult.

The means are those of the survey ANSUR II (C. C. Gordon et al., "2012 Anthropometric Survey of U.S. Army Personnel:
Methods and Summary Statistics", Natick/TR-15/007, 2014; 1,986 women and 4,082 men), halfway between women and men: neck
circumference 364 mm (330 and 398), breadth across the deltoids 480 mm (450 and 510), breadth between the acromia, the
outer ends of the shoulder blades, 390 mm (365 and 416), which lie 304 mm (293 and 316) below the crown. Chest depth is
251 mm (247 and 254) at the nipples, below the bust. With nipples 46 cm below the crown (an estimate), and a depth that
grows evenly from the neck to there, the bust is 160 mm deep 32 cm below the crown and 198 mm at its lower end.
"""

from dataclasses import astuple, dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.smoothstep import smoothstep

GAP, TILT = 0.004, 0.2
"""Depth below the chin, metres, of the plane below which points move, and its rise towards the back, with which it
passes below jaw and ears."""
NECK, BUST = 0.035, 0.10
"""Depths below this plane at which the changes of the neck and of the shoulders are complete, metres."""
COLLAR, CHEST = 0.06, 0.20
"""Depths at which the change of the chest's depth begins and is complete, metres."""
LOWER = 0.20
"""Depth at which the bust does not rise with the shoulders, metres."""
ROOT, TIP = 0.04, 0.15
"""Distances from the middle of the body between which the shoulders' rise sets in, metres: collar bones turn about
their inner ends."""
AXIS = 0.111
"""Distance of the axis of neck and bust behind the chin, metres."""


@dataclass(frozen=True)
class Shoulders:
    """Changes of a template's neck and shoulders.

    Attributes:
        neck: share by which the neck, and all below it, becomes broader and deeper.
        breadth: share by which the shoulders become broader, in addition.
        depth: share by which the chest becomes deeper, in addition.
        rise: height by which the shoulders rise, metres.
        forward: distance by which shoulders and chest move forward, metres.
    """

    neck: float = 0.0
    breadth: float = 0.0
    depth: float = 0.0
    rise: float = 0.0
    forward: float = 0.0

    def sentence(self) -> str:
        """The changes of the shoulders, for the user."""
        return (
            f"Shoulders against the template's: {100 * self.breadth:+.0f} % broad, {100 * self.depth:+.0f} % deep, "
            f"{1000 * self.rise:+.0f} mm high, {1000 * self.forward:+.0f} mm forward."
        )


MEAN = Shoulders(neck=0.15, breadth=0.05, depth=0.44, rise=0.008)
"""What gives the mannequin the neck and the shoulders of a mean adult."""


def with_shoulders(
    points: Float[Tensor, "point 3"], chin: Float[Tensor, "3"], change: Shoulders
) -> Float[Tensor, "point 3"]:
    """Change neck and shoulders of a template; nothing moves above the plane below chin, jaw and ears.

    Args:
        points: points of the template, metres, y up, +z out of the face.
        chin: its landmark.
        change: the changes.
    """
    return points + torch.einsum("c,cpk->pk", points.new_tensor(astuple(change)), movements(points, chin))


def shoulder_share(points: Float[Tensor, "point 3"], chin: Float[Tensor, "3"]) -> Float[Tensor, " point"]:
    """Share of a point that belongs to the shoulders: 0 above the plane, 1 from `BUST` below it on."""
    return smoothstep(_depth(points - chin) / BUST)


def _depth(places: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
    """Depth of places, relative to the chin, below the plane."""
    return -GAP - places[:, 1] - TILT * places[:, 2]


def movements(points: Float[Tensor, "point 3"], chin: Float[Tensor, "3"]) -> Float[Tensor, "change point 3"]:
    """Movement of points per unit of each change in `Shoulders`, in this order."""
    x, _, z = (points - chin).unbind(dim=1)
    below, bust = _depth(points - chin), shoulder_share(points, chin)
    neck = smoothstep(below / NECK)
    chest = smoothstep((below - COLLAR) / (CHEST - COLLAR))
    rise = neck * smoothstep((x.abs() - ROOT) / (TIP - ROOT)) * (1.0 - smoothstep((below - BUST) / (LOWER - BUST)))
    back, none = z + AXIS, torch.zeros_like(x)
    moved = (
        (neck * x, none, neck * back),
        (bust * x, none, none),
        (none, none, chest * back),
        (none, rise, none),
        (none, none, bust),
    )
    return torch.stack([torch.stack(each, dim=1) for each in moved])
