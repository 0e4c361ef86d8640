"""Raises the skull of a fitted head until it touches the lowest hair above it.

Photographs do not show the skull under the hair, so a fitted head has the height of its template. If it is too low,
strands start far below the hair and stay there. But somewhere above the brows hair leaves the skin in sight: at the
hairline, a parting or a whorl. There, the line segments of multi-view stereo reach down to the skin. If even the lowest
of them lie above the fitted skull, it is too low, and it is raised along the directions away from its middle: not at
all at the height of the brows, and fully at the crown. Where views look down on the skin between the hairs, it is
raised to the lowest hair of that place instead (`lowest_hair.py`), so that front, sides, back and top may differ. It is
never lowered, because hair may cover the skin everywhere.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.views import Part, Views
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.lift import SkullLift, upwards
from neural_strands.preparation.head.refinement.lowest_hair import lowest_hair

UPPER = 0.5
"""Hair counts if the skull below it is raised by at least this share."""
TOUCHING = 0.01
"""Share of the hair's points over the upper skull that are assumed to lie on the skin. Above true heads, this quantile
of the heights is -1 and -3 mm if hair leaves the skin in sight, and 6 mm if it hides the skin everywhere."""
MOST = 0.015
"""Largest lift, metres: an estimate of how far a skull may rise above the template's."""
THICKEST = 0.06
"""Largest height above the skull at which hair is searched, metres."""
FEWEST = 1000
"""Fewest points of hair over the upper skull from which its height is judged."""
SURE = 0.3
"""Least confidence of a point."""
LONGEST_SIDE = 320
"""Size of the photographs that stereo uses, pixels; it only has to find the lowest hair."""


def raise_skull(fitted: FittedHead, views: Views, say: Callable[[str], None]) -> FittedHead:
    """Find the lowest hair in photographs and raise the skull to it.

    Args:
        fitted: a head placed on the person.
        views: the photographs, with hair masks and with cameras in the head's world.
        say: receives messages for the user.

    Returns:
        The head with its landmarks, and `skull_raised_mm` among its figures.
    """
    chosen = over_skull(views.reduced(LONGEST_SIDE), fitted)
    settings, random = LmvsConfig(complete="never"), torch.Generator().manual_seed(0)
    try:
        segments = reconstruct(chosen, fitted.head.mesh, settings, random, track=_shown)
    except InputError as error:
        say(f"The skull keeps the template's height, because its hair could not be measured: {error}")
        return _with_lift(fitted, SkullLift(0.0, torch.zeros(0, 3), torch.zeros(0)))
    lift = skull_lift(fitted, segments.points[segments.confidence >= SURE], chosen.cameras)
    raised = _with_lift(fitted, lift)
    if not lift.is_none:
        say(f"The skull was raised by {raised.figures['skull_raised_mm']:.1f} mm, to the lowest hair above it.")
    return raised


def skull_lift(fitted: FittedHead, points: Float[Tensor, "point 3"], cameras: Sequence[Camera]) -> SkullLift:
    """Heights by which the skull must be raised to touch the lowest hair above it, at most `MOST`.

    Args:
        fitted: a head placed on the person.
        points: points of its hair, world metres; a small share may be wrong.
        cameras: cameras of the views that show them.
    """
    mesh = fitted.head.mesh
    closest, sign = MeshIndex(mesh, winding_number=True).closest_signed(points)
    share, _ = upwards(fitted, closest.position)
    over = (share > UPPER) & torch.isin(closest.face, fitted.head.scalp_faces)
    if int(over.sum()) < FEWEST:
        return SkullLift(0.0, torch.zeros(0, 3), torch.zeros(0))
    height = (sign * closest.distance / share)[over].sort().values
    everywhere = min(max(float(height[int(TOUCHING * len(height))]), 0.0), MOST)
    places, heights = lowest_hair(fitted, points, cameras)
    return SkullLift(everywhere, places, heights.clamp(0.0, MOST))


def over_skull(views: Views, fitted: FittedHead) -> Views:
    """Limit hair masks to hair over the upper skull: what lies elsewhere costs time and tells nothing."""
    vertices = fitted.head.mesh.vertices
    share, outward = upwards(fitted, vertices)
    skull = share > UPPER
    # The upper skull is convex, and so is the space up to a height above it.
    shell = torch.cat([vertices[skull], (vertices + THICKEST * outward)[skull]])

    def read(index: int, part: Part) -> Tensor | None:
        found = views.read(index, part)
        if part != "hair_mask" or found is None:
            return found
        return found * _seen_hull(views.cameras[index], shell).to(found)

    return replace(views, read=read)


def _seen_hull(camera: Camera, points: Float[Tensor, "point 3"]) -> Bool[Tensor, "height width"]:
    """The pixels of the convex hull of points in front of a camera."""
    pixels, depth = camera.project(points)
    inside = np.zeros((camera.height, camera.width), np.uint8)
    if bool((depth > 0).all()):
        corners = cv2.convexHull(np.rint(pixels.numpy()).astype(np.int32))
        cv2.fillConvexPoly(inside, corners, 1)
    return torch.from_numpy(inside > 0)


def _with_lift(fitted: FittedHead, lift: SkullLift) -> FittedHead:
    """The head with its skull raised, and the mean lift of the upper skull among its figures."""
    vertices = fitted.head.scalp_mesh.corners().mean(dim=1)
    share, _ = upwards(fitted, vertices)
    mean = float(lift.at(fitted, vertices[share > UPPER]).mean())
    return replace(lift.applied(fitted), figures={**fitted.figures, "skull_raised_mm": round(1000 * mean, 1)})


def _shown(items: Iterable[int], text: str, total: int) -> Iterable[int]:
    return track(items, f"measuring the skull: {text}", total)
