"""Fits the shoulders of a placed template to outlines of the person.

Hair hides a part of the shoulders' outline, clothes add to it, and the frame of a picture cuts it off. So all views
together determine four numbers, by least squares in which points of the template's outline that stay far from the
person's count little. Without evidence, the shoulders keep the template's size.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, interpolate
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.outline import Outline
from neural_strands.preparation.head.shoulders import TIP, Shoulders, movements, with_shoulders
from neural_strands.preparation.head.template import Template
from neural_strands.preparation.robust import geman_mcclure

SPREAD = (0.08, 0.15, 0.025, 0.02)
"""Expected sizes of a person's differences from the template: breadth, depth, rise and forward of `Shoulders`. Those of
height include posture."""
SIDE = 256
"""Longer side at which outlines are compared, pixels."""
ROUNDS, COARSE, FINE = 8, 0.06, 0.012
"""Rounds of the fit, and error of an outline in the first and in the last, metres."""
VIEW_POINTS = 4.0
"""Number of independent points that the outline of a view counts as."""
BOTTOM = 0.03
"""Height above the lower end of the bust at which its outline begins to count, metres: there it was only cut off."""
DOWN = -0.3
"""Least upward part of the direction in which a counted outline faces, for the same reason."""
STILL = 0.01
"""Movement per unit of a change below which a point is not part of the shoulders."""


def fit_shoulders(
    template: Template, cameras: Sequence[Camera], outlines: Sequence[Bool[np.ndarray, "height width"]]
) -> tuple[Template, Shoulders]:
    """Fit the shoulders of a placed template (world metres) to outlines of the person.

    Args:
        template: the template; if it has no shoulders or no chin, it stays as it is.
        cameras: cameras of the views with an outline.
        outlines: for each of these, whether each pixel shows the person.

    Returns:
        The template, and how its shoulders have changed.
    """
    rest, chin = template.head.mesh, template.landmarks[NAMED["chin"]]
    moved = movements(rest.vertices, chin)[1:]
    if not bool((rest.vertices[:, 0] - chin[0]).abs()[moved[0].abs().sum(dim=1) > 0].gt(TIP).any()):
        return template, Shoulders()
    pairs = zip(cameras, outlines, strict=True)
    views = [Outline.of(camera, outline.astype(np.float32), SIDE) for camera, outline in pairs]
    sizes = torch.zeros(len(SPREAD))
    for error in np.geomspace(COARSE, FINE, ROUNDS).tolist():
        current = Mesh(rest.vertices + torch.einsum("c,cpk->pk", sizes, moved), rest.faces)
        system, right = torch.diag(torch.tensor(SPREAD) ** -2), torch.zeros(len(SPREAD))
        for view in views:
            gap, slope = _gaps(view, current, moved)
            weight = geman_mcclure((gap / error) ** 2) / error**2 * min(1.0, VIEW_POINTS / max(len(gap), 1))
            system = system + slope.T @ (weight[:, None] * slope)
            right = right + slope.T @ (weight * (slope @ sizes - gap))
        sizes = torch.linalg.solve(system, right)
    change = Shoulders(0.0, *sizes.tolist())
    mesh = replace(rest, vertices=with_shoulders(rest.vertices, chin, change))
    return replace(template, head=replace(template.head, mesh=mesh)), change


def _gaps(
    outline: Outline, mesh: Mesh, moved: Float[Tensor, "change vertex 3"]
) -> tuple[Float[Tensor, " point"], Float[Tensor, "point change"]]:
    """Distances of the shoulders' outline from the person's, metres, and how changes change them."""
    contour, rotation = outline.contour(mesh), outline.camera.rotation
    height = interpolate(mesh.corners(), contour.face, contour.barycentric)[:, 1]
    movement = torch.einsum("cpkx,pk->pcx", moved[:, mesh.faces[contour.face]], contour.barycentric)
    shoulder = (movement.abs().amax(dim=(1, 2)) > STILL) & (height > mesh.vertices[:, 1].min() + BOTTOM)
    kept = shoulder & (contour.outward @ rotation[:2, 1] > DOWN)
    slope = torch.einsum("pck,ik,pi->pc", movement, rotation[:2], contour.away)
    return contour.gap[kept], slope[kept]
