"""Fits the shoulders of a placed template to outlines of the person.

Hair hides a part of the shoulders' outline, clothes add to it, and the frame of a picture cuts it off. So all views
together determine four numbers, by least squares in which points of the template's outline that stay far from the
person's count little. Without evidence, the shoulders keep the template's size.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, interpolate
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.shoulders import TIP, Shoulders, movements, with_shoulders
from neural_strands.preparation.head.template import Template
from neural_strands.raster.triangles import rasterise_triangles

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
    views = [_Outline.of(camera, outline) for camera, outline in zip(cameras, outlines, strict=True)]
    sizes = torch.zeros(len(SPREAD))
    for error in np.geomspace(COARSE, FINE, ROUNDS).tolist():
        current = Mesh(rest.vertices + torch.einsum("c,cpk->pk", sizes, moved), rest.faces)
        system, right = torch.diag(torch.tensor(SPREAD) ** -2), torch.zeros(len(SPREAD))
        for view in views:
            gap, slope = view.gaps(current, moved)
            # Geman-McClure weights, as in `deform`.
            weight = (1.0 + (gap / error) ** 2) ** -2 / error**2 * min(1.0, VIEW_POINTS / max(len(gap), 1))
            system = system + slope.T @ (weight[:, None] * slope)
            right = right + slope.T @ (weight * (slope @ sizes - gap))
        sizes = torch.linalg.solve(system, right)
    change = Shoulders(0.0, *sizes.tolist())
    mesh = replace(rest, vertices=with_shoulders(rest.vertices, chin, change))
    return replace(template, head=replace(template.head, mesh=mesh)), change


@dataclass(frozen=True)
class _Outline:
    """The outline of a person in a small picture.

    Attributes:
        camera: camera of the small picture.
        distance: signed distance of pixels from the outline, positive outside, pixels.
        away: unit direction in which it grows.
    """

    camera: Camera
    distance: Float32[Tensor, "height width"]
    away: Float32[Tensor, "height width 2"]

    @classmethod
    def of(cls, camera: Camera, outline: Bool[np.ndarray, "height width"]) -> "_Outline":
        small = camera.reduced(SIDE)
        person = cv2.resize(outline.astype(np.float32), (small.width, small.height), interpolation=cv2.INTER_AREA)
        distance = _signed_distance(person > 0.5)
        return cls(small, distance, _growth(distance))

    def gaps(
        self, mesh: Mesh, moved: Float[Tensor, "change vertex 3"]
    ) -> tuple[Float[Tensor, " point"], Float[Tensor, "point change"]]:
        """Signed distances of points on the mesh's own outline from this one, metres, and how changes change them."""
        camera = self.camera
        buffer = rasterise_triangles(mesh.vertices, mesh.faces, camera)
        own = _signed_distance((buffer.face >= 0).numpy())
        row, column = torch.nonzero((own < 0) & (own > -1)).unbind(dim=1)
        face, weights = buffer.face[row, column], buffer.barycentric[row, column]
        height = interpolate(mesh.corners(), face, weights)[:, 1]
        movement = torch.einsum("cpkx,pk->pcx", moved[:, mesh.faces[face]], weights)
        upward = _growth(own)[row, column] @ camera.rotation[:2, 1]
        # Beyond the border of the picture nothing is known.
        border = torch.stack([row, column, camera.height - 1 - row, camera.width - 1 - column]).amin(dim=0)
        distance, away = self.distance[row, column], self.away[row, column]
        shoulder = (movement.abs().amax(dim=(1, 2)) > STILL) & (height > mesh.vertices[:, 1].min() + BOTTOM)
        kept = shoulder & (upward > DOWN) & (border > 0) & (-distance < border)
        metres = buffer.depth[row, column] / camera.intrinsics[0, 0]
        slope = torch.einsum("pck,ik,pi->pc", movement, camera.rotation[:2], away)
        return (distance * metres)[kept], slope[kept]


def _signed_distance(inside: Bool[np.ndarray, "height width"]) -> Float32[Tensor, "height width"]:
    """Distance of pixels from the border of a region, negative inside, pixels; the picture's border is none."""
    # Without a border, OpenCV's distances are huge.
    within, beyond = (
        cv2.distanceTransform(each.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE).clip(max=sum(inside.shape))
        for each in (inside, ~inside)
    )
    return torch.from_numpy(np.where(inside, 0.5 - within, beyond - 0.5).astype(np.float32))


def _growth(distance: Float32[Tensor, "height width"]) -> Float32[Tensor, "height width 2"]:
    """Unit direction in the picture in which a distance grows."""
    rows, columns = np.gradient(cv2.GaussianBlur(distance.numpy(), (0, 0), 1.5))
    return torch.nn.functional.normalize(torch.from_numpy(np.stack([columns, rows], axis=-1)), dim=-1)
