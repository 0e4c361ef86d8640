"""Continues a fitted bust downwards, as far as photographs show the person.

A template ends below the shoulders, and photographs often do not: without a surface there, a model would lose the rest
of the person. The lowest part of the bust moves down, and a wall closes the gap.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Int64
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import Views
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.shoulders import TIP
from neural_strands.preparation.head.template import Template
from neural_strands.raster.triangles import rasterise_triangles

CUT = 0.025
"""Height above the lower end of the bust from which on everything moves down, metres: its edge may be rounded."""
ROWS, STEP = 25, 0.012
"""Largest number of rows of the wall, and their height, metres."""
SIDE = 256
"""Longer side at which photographs are searched for the person, pixels."""
PERSON, HAIR = 0.9, 0.05
"""Coverage from which a pixel shows the person, and up to which it shows no hair."""
SHARE = 0.8
"""Least share of a row's pixels in all photographs together that must show the person: elsewhere nobody is."""
PIXELS, FEWEST = 8, 3
"""Fewest such pixels in a photograph that counts as showing a row, and fewest such photographs."""


def with_torso(fitted: FittedHead, template: Template, views: Views) -> FittedHead:
    """Continue a bust as far down as photographs show the person.

    Args:
        fitted: a head placed on the person, upright. All of its vertices and faces keep their numbers.
        template: what it was made from, which tells the lowest part. If it has no shoulders, the head stays as it is.
        views: the photographs, with cameras in the head's world; those without a mask of the person are not used.
    """
    mesh, cut = fitted.head.mesh, _Cut.of(template.head.mesh)
    if not cut.has_shoulders:
        return fitted
    rows = _shown_rows(mesh, cut, views)
    return replace(fitted, head=replace(fitted.head, mesh=_continued(mesh, cut, rows))) if rows else fitted


@dataclass(frozen=True)
class _Cut:
    """Where a bust is cut.

    Attributes:
        moving: whether each vertex moves down.
        below: whether each face has such a vertex.
        edges: those between the other faces and these, directed as in the other faces.
        has_shoulders: whether the cut is as broad as shoulders.
    """

    moving: Bool[Tensor, " vertex"]
    below: Bool[Tensor, " face"]
    edges: Int64[Tensor, "edge 2"]
    has_shoulders: bool

    @classmethod
    def of(cls, mesh: Mesh) -> "_Cut":
        height = mesh.vertices[:, 1]
        moving, count = height < height.min() + CUT, len(height)
        below = moving[mesh.faces].any(dim=1)
        start, end = mesh.faces, mesh.faces.roll(-1, dims=1)
        stay, moved = ((a * count + b)[part].flatten() for a, b, part in ((start, end, ~below), (end, start, below)))
        code = stay[torch.isin(stay, moved)]
        across = mesh.vertices[code // count, 0]
        broad = len(code) > 0 and float(across.max() - across.min()) > 2 * TIP
        return cls(moving, below, torch.stack([code // count, code % count], dim=1), broad)


def _shown_rows(mesh: Mesh, cut: _Cut, views: Views) -> int:
    """Number of rows by which photographs show the person farther down."""
    longest, wall = _continued(mesh, cut, ROWS), torch.arange(ROWS).repeat_interleave(2 * len(cut.edges))
    row = torch.cat([torch.full((len(mesh.faces),), -1), wall])
    showing, pixels, covered = torch.zeros(3, ROWS, dtype=torch.int64)
    for view in views.reduced(SIDE):
        if view.person_mask is None:
            continue
        face = rasterise_triangles(view.camera.posed(longest.vertices), longest.faces, view.camera).face
        person, hair = view.person_mask, view.hair_mask
        bare = torch.ones_like(person, dtype=torch.bool) if hair is None else hair < HAIR
        seen = torch.where((face >= 0) & bare, row[face.clamp(min=0)], -1)
        here, people = (
            torch.bincount(seen[counted & (seen >= 0)], minlength=ROWS) for counted in (seen >= 0, person > PERSON)
        )
        pixels, covered, showing = pixels + here, covered + people, showing + (people >= PIXELS)
    nobody = covered < SHARE * pixels
    missing = torch.nonzero((showing < FEWEST) | nobody).flatten()
    if len(missing) == 0:
        return ROWS
    # The part that moves reaches below the wall.
    end = int(missing[0])
    return max(end - round(CUT / STEP), 0) if nobody[end] else end


def _continued(mesh: Mesh, cut: _Cut, rows: int) -> Mesh:
    """Move the lowest part of a mesh down by a number of rows, and close the gap by a wall."""
    count, rim = len(mesh.vertices), cut.edges.unique()
    down = torch.zeros(rows, 1, 3)
    down[:, 0, 1] = -STEP * torch.arange(1, rows + 1)
    vertices = torch.where(cut.moving[:, None], mesh.vertices + down[-1], mesh.vertices)
    # Every row of the wall ends at a copy of the rim; the part that moves is joined to the last one.
    place = torch.zeros(count, dtype=torch.int64)
    place[rim] = torch.arange(len(rim))
    copies = [cut.edges] + [count + row * len(rim) + place[cut.edges] for row in range(rows)]
    lowest = torch.arange(count)
    lowest[rim] = count + (rows - 1) * len(rim) + place[rim]
    faces = torch.where(cut.below[:, None], lowest[mesh.faces], mesh.faces)
    (a, b), (c, d) = (torch.cat(each).unbind(dim=1) for each in (copies[:-1], copies[1:]))
    wall = torch.stack([b, a, c, b, c, d], dim=1).view(-1, 3)
    uv = None if mesh.corner_uv is None else torch.cat([mesh.corner_uv, mesh.corner_uv.new_zeros(len(wall), 3, 2)])
    return Mesh(torch.cat([vertices, (mesh.vertices[rim] + down).view(-1, 3)]), torch.cat([faces, wall]), uv)
