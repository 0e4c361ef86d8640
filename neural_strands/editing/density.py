"""Changes the number of strands: more or fewer than were fitted, decoded from the scalp textures."""

from dataclasses import replace

import torch
from jaxtyping import Float
from scipy.spatial import Delaunay, KDTree
from torch import Tensor

from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.settings import Density
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.frames import orthonormal_frames
from neural_strands.geometry.mesh import Mesh, face_areas, interpolate
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.strands import lengths
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.texture import sample_texture
from neural_strands.scalp.blue_noise import eliminate
from neural_strands.scalp.roots import CANDIDATES

LONGEST_EDGE = 4.0
"""Longest edge between neighbouring roots, in median edges: longer ones span gaps of the chart."""
STRAY = 0.12
"""A new strand is a stray if its mean distance from every neighbour exceeds this share of their lengths."""
NEIGHBOURS, COMPARED = 4, 12
"""Number of neighbours that a new strand is compared with, and of points compared on each."""
FEWEST = 3
"""Fewest roots that span a surface."""


@torch.no_grad()
def change_density(density: Density, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """Sample the same texture at another number of roots: present ones first, then new ones in between.

    Raises:
        InputError: too few roots to span a scalp.
    """
    random = torch.Generator().manual_seed(density.seed)
    surface = root_surface(shape)
    new = _between_roots(shape, surface, CANDIDATES * density.strands, random)
    new = replace(new, position=_on_body(new.position, model))
    # Sample elimination prefers earlier candidates.
    order = torch.randperm(len(shape.uv), generator=random).to(shape.uv.device)
    parts = [torch.cat([getattr(shape, name)[order], getattr(new, name)]) for name in ("position", "uv", "frame")]
    kept = eliminate(parts[0].cpu(), density.strands, float(face_areas(surface).sum())).to(order.device)
    position, uv, frame = (part[kept] for part in parts)
    fresh = kept >= len(order)
    uv[fresh] = _without_strays(uv[fresh], position[fresh], shape, model)
    return replace(shape, position=position, uv=uv, frame=frame)


def _without_strays(
    uv: Float[Tensor, "new 2"], position: Float[Tensor, "new 3"], shape: ScalpShape, model: HairModel
) -> Float[Tensor, "new 2"]:
    """Chart places of new roots; one whose strand resembles none of its neighbours' takes the nearest one's place.

    Between texels with very different strands, as along a parting, the texture interpolates to strands that no
    photograph has shaped.
    """
    known = model.generator(sample_texture(shape.texture, shape.uv), COMPARED)
    grown = model.generator(sample_texture(shape.texture, uv), COMPARED)
    count = min(NEIGHBOURS, len(shape.uv))
    near = torch.from_numpy(KDTree(shape.position.cpu().numpy()).query(position.cpu().numpy(), k=count)[1])
    near = near.reshape(len(uv), count).to(uv.device)
    gap = (known[near] - grown[:, None]).norm(dim=-1).mean(dim=-1)
    stray = gap.amin(dim=1) > STRAY * lengths(known)[near].mean(dim=1)
    return torch.where(stray[:, None], shape.uv[near[:, 0]], uv)


def root_surface(shape: ScalpShape) -> Mesh:
    """Triangulate the roots: neighbours on the chart (Delaunay) that are also close in space.

    Raises:
        InputError: there are too few roots, or all are on a line.
    """
    if len(shape.uv) < FEWEST:
        raise InputError(f"density: expected a model of at least {FEWEST} roots, found {len(shape.uv)}; fit again.")
    faces = torch.from_numpy(Delaunay(shape.uv.cpu().double().numpy(), qhull_options="QJ").simplices).long()
    mesh = Mesh(shape.position, faces.to(shape.position.device))
    corners = mesh.corners()
    longest = (corners - corners.roll(1, dims=1)).norm(dim=-1).amax(dim=1)
    return replace(mesh, faces=mesh.faces[longest <= LONGEST_EDGE * longest.median()])


def _between_roots(shape: ScalpShape, surface: Mesh, count: int, random: torch.Generator) -> ScalpShape:
    """Roots at random positions between the present ones, uniform by area."""
    corners, device = surface.corners(), shape.position.device
    cumulative = face_areas(surface).double().cumsum(0)
    drawn, first, second = torch.rand(3, count, generator=random, dtype=torch.float64).to(device)
    face = torch.searchsorted(cumulative, drawn * cumulative[-1], right=True).clamp(max=len(cumulative) - 1)
    root = first.sqrt()
    weights = torch.stack([1 - root, root * (1 - second), root * second], dim=-1).to(corners)
    at_corners = surface.faces
    normal, tangent = (interpolate(shape.frame[at_corners][..., axis], face, weights) for axis in (2, 0))
    return replace(
        shape,
        position=interpolate(corners, face, weights),
        uv=interpolate(shape.uv[at_corners], face, weights),
        frame=orthonormal_frames(normal, tangent),
    )


def _on_body(position: Float[Tensor, "root 3"], model: HairModel) -> Float[Tensor, "root 3"]:
    """The closest points on the body's surface; unchanged if the model has no body."""
    body = model.body.mesh
    return closest_points(position, body).position if len(body.faces) and len(position) else position
