"""Heights of the lowest hair above the skull, at places where photographs look down on the skin between the hairs.

Hair that lets the skin be seen has its lowest segments on the skin: their heights pile up at one value. Where hair
hides the skin, the lowest heights are mostly spread out, because segments lie wherever a gap ends, or far above the
skull. Views that graze the skull see only the outermost hair, whose heights pile up too, so a place counts only if
several views look down on it.
"""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import vertex_normals
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.lift import mirrored, upwards

RINGS = ((90.0, 0), (65.0, 4), (42.0, 6), (20.0, 8))
"""Places on one half of the skull: elevation, degrees, and number of steps from the front to the back."""
AROUND = 18.0
"""Angle from a place within which hair belongs to it, degrees."""
FEWEST = 300
"""Fewest points of hair from which the height at a place is judged."""
STEEP, FEWEST_VIEWS = 45.0, 3
"""Largest angle to the skull's normal at which a view looks down on it, degrees, and fewest such views of a place."""
LOWEST, LOW, PILED = 0.01, 0.1, 0.004
"""Two low quantiles of the heights, and their largest difference, metres, if hair lies on the skin: 1 to 4 mm where
true heads show through hair, mostly more where it hides them."""
SKIN = 0.05
"""Quantile of the heights that lies on the skin."""
HIGHEST = 0.020
"""Heights above this are those of hair that stands off the head, metres."""


def lowest_hair(
    fitted: FittedHead, points: Float[Tensor, "point 3"], cameras: Sequence[Camera]
) -> tuple[Float[Tensor, "place 3"], Float[Tensor, " place"]]:
    """Measure the height of the skin over a fitted skull where hair lets it be seen.

    Args:
        fitted: a head placed on the person.
        points: points of its hair, world metres.
        cameras: cameras of the views that show them.

    Returns:
        Unit directions of the places from the middle of the head, with x >= 0, and the heights there, metres; negative
        where the skull is too high.
    """
    mesh, scalp = fitted.head.mesh, fitted.head.scalp_faces
    closest, sign = MeshIndex(mesh, winding_number=True).closest_signed(points)
    over = torch.isin(closest.face, scalp)
    height = (sign * closest.distance)[over]
    hair = mirrored(upwards(fitted, closest.position[over])[1])
    vertices = mesh.faces[scalp].unique()
    skull = mirrored(upwards(fitted, mesh.vertices[vertices])[1])
    views = _views_from_above(mesh.vertices[vertices], vertex_normals(mesh)[vertices], cameras)
    places, heights = [], []
    for place in _places():
        here = height[_near(hair, place)].sort().values
        seen = views[_near(skull, place)]
        if len(here) < FEWEST or len(seen) == 0 or float(seen.median()) < FEWEST_VIEWS:
            continue
        low, high, skin = (float(here[int(share * len(here))]) for share in (LOWEST, LOW, SKIN))
        if high - low <= PILED and skin <= HIGHEST:
            places.append(place)
            heights.append(skin)
    return torch.stack(places) if places else torch.zeros(0, 3), torch.tensor(heights)


def _places() -> list[Float[Tensor, "3"]]:
    turns = [
        (math.radians(elevation), math.pi * step / max(steps, 1))
        for elevation, steps in RINGS
        for step in range(steps + 1)
    ]
    return [
        torch.tensor([math.cos(up) * math.sin(turn), math.sin(up), math.cos(up) * math.cos(turn)]) for up, turn in turns
    ]


def _near(directions: Float[Tensor, "point 3"], place: Float[Tensor, "3"]) -> Bool[Tensor, " point"]:
    return directions @ place > math.cos(math.radians(AROUND))


def _views_from_above(
    points: Float[Tensor, "point 3"], normals: Float[Tensor, "point 3"], cameras: Sequence[Camera]
) -> Float[Tensor, " point"]:
    """Number of cameras that look down on each point of the skull."""
    count = torch.zeros(len(points))
    for camera in cameras:
        towards = torch.nn.functional.normalize(camera.position - points, dim=1)
        count += (towards * normals).sum(dim=1) > math.cos(math.radians(STEEP))
    return count
