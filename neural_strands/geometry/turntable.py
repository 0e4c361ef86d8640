"""Cameras on a circle around strands."""

import math

from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera

FIELD_OF_VIEW = math.radians(25.0)
"""Field of view of the shorter side of the image, radians."""
FRAMING = 1.25
"""Radius of the sphere that fits into the image, in multiples of the points' radius."""
FARTHEST = 0.98
"""Share of the points that determine this radius: single flyaway strands may leave the image."""


def turntable_cameras(
    points: Float[Tensor, "strand point 3"], count: int, size: tuple[int, int], elevation: float = 0.15
) -> list[Camera]:
    """Cameras on a level circle around strands, the first one in front (+z), then towards +x.

    Args:
        points: strands in world metres.
        count: number of cameras, evenly spaced over the whole turn.
        size: image width and height in pixels.
        elevation: height of the circle above the centre, radians.

    Raises:
        ValueError: there is no finite point to look at.

    Examples:
        >>> import neural_strands as ns
        >>> strands = ns.read_groom("run/groom.npz").strands()
        >>> [camera.name for camera in ns.turntable_cameras(strands.points, count=3, size=(64, 64))]
        ['0000', '0001', '0002']
    """
    flat = points.reshape(-1, 3)
    flat = flat[flat.isfinite().all(dim=1)]
    if len(flat) == 0:
        raise ValueError("expected strands with finite points to turn around, found none")
    centre = 0.5 * (flat.min(dim=0).values + flat.max(dim=0).values)
    distance = (flat - centre).norm(dim=1)
    radius = float(distance.kthvalue(1 + int(FARTHEST * (len(distance) - 1))).values)
    away = FRAMING * max(radius, 1e-3) / math.sin(FIELD_OF_VIEW / 2)
    focal = 0.5 * min(size) / math.tan(FIELD_OF_VIEW / 2)
    cameras = []
    for index in range(count):
        turn = 2 * math.pi * index / count
        level = math.cos(elevation)
        offset = centre.new_tensor([level * math.sin(turn), math.sin(elevation), level * math.cos(turn)])
        cameras.append(Camera.look_at(centre + away * offset, centre, focal, size, f"{index:04d}"))
    return cameras
