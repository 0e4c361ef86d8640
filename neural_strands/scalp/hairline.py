"""Finds the scalp of any upright head from its geometry alone, by proportions in units of the head's width.

The head's width is measured from the top: walking down from the highest point, the depth at which the head stops being
twice as wide as that depth is a little below its widest ring. The hairline is then given as a depth below the crown for
each direction around the head's axis, from anatomical proportions: forehead, temple, around the ear, nape.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.scalp.patches import pieces

HAIRLINE_DEGREES = (0.0, 25.0, 45.0, 58.0, 68.0, 76.0, 84.0, 100.0, 112.0, 122.0, 140.0, 180.0)
"""Directions from the face (0) over the ear (90) to the nape (180)."""

HAIRLINE_DEPTH = (0.36, 0.36, 0.42, 0.56, 0.72, 0.80, 0.68, 0.66, 0.76, 0.98, 1.10, 1.14)
"""Depth of the hairline below the crown in those directions, in head widths."""

AXIS_BEHIND = 0.02
"""Distance of the axis of those directions behind the middle of the head, in head widths."""

SKIPPED = 0.02
"""Share of the mesh's height, from the top, that is skipped: too few vertices there to measure a width."""

OUTSIDE = 1e-3
"""Height above a face, in head widths, at which it is tested whether the face lies on the outer skin."""


@dataclass(frozen=True)
class HeadMeasure:
    """Position of the head in a mesh of a head, a bust or a whole person.

    Attributes:
        crown: highest point of the axis, mesh units.
        width: width of the head above the ears, mesh units.
    """

    crown: Float[Tensor, "3"]
    width: float


def measure_head(vertices: Float[Tensor, "vertex 3"]) -> HeadMeasure:
    """Measure the topmost round part of an upright mesh (y up, +z out of the face)."""
    order = torch.argsort(vertices[:, 1], descending=True)
    above = vertices[order]
    depth = above[0, 1] - above[:, 1]
    widest = above[:, 0].cummax(0).values - above[:, 0].cummin(0).values
    reached = torch.nonzero((depth >= 0.55 * widest) & (depth > SKIPPED * depth[-1])).squeeze(1)
    last = int(reached[0]) if len(reached) else len(above) - 1
    cap = above[: last + 1]
    middle = 0.5 * (cap.max(dim=0).values + cap.min(dim=0).values)
    return HeadMeasure(torch.stack([middle[0], above[0, 1], middle[2]]), float(widest[last]))


def scalp_faces(mesh: Mesh) -> Int64[Tensor, " scalp"]:
    """Find the faces that hair grows from on an upright head (y up, +z out of the face), in any unit.

    Raises:
        ValueError: no face lies above the hairline.
    """
    measure = measure_head(mesh.vertices)
    corners = (mesh.corners() - measure.crown) / measure.width
    centre = corners.mean(dim=1)
    direction = torch.rad2deg(torch.atan2(centre[:, 0].abs(), centre[:, 2] + AXIS_BEHIND))
    limit = np.interp(direction.cpu().numpy(), HAIRLINE_DEGREES, HAIRLINE_DEPTH)
    above = -centre[:, 1] < torch.from_numpy(limit).to(centre)
    candidates = torch.nonzero(above).squeeze(1)
    candidates = candidates[_on_outer_skin(mesh, candidates, measure.width)]
    if len(candidates) == 0:
        raise ValueError("no face lies above the hairline")
    faces = mesh.faces[candidates].cpu().numpy()
    parts = pieces(faces)
    areas = 0.5 * torch.linalg.cross(
        corners[candidates, 1] - corners[candidates, 0], corners[candidates, 2] - corners[candidates, 0]
    ).norm(dim=-1)
    largest = max(parts, key=lambda part: float(areas[part].sum()))
    return candidates[torch.from_numpy(np.sort(largest)).to(candidates.device)]


def _on_outer_skin(mesh: Mesh, faces: Int64[Tensor, " face"], width: float) -> Tensor:
    """Whether the space just above each face is outside the mesh; false for eyes, mouths and inner walls."""
    corners = mesh.vertices[mesh.faces[faces]]
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1)
    above = corners.mean(dim=1) + OUTSIDE * width * torch.nn.functional.normalize(normal, dim=-1)
    return signed_distance(above, mesh).distance > 0
