"""Skin of the head and the surroundings behind it: smooth random textures."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.geometry.mesh import Mesh
from neural_strands.scalp.head import Head

SKIN = (0.60, 0.385, 0.30)
"""Linear RGB albedo of lit skin."""
SCALP_SHADE = 0.75
"""Share of the hair's colour in the scalp's, for stubble and shadow that are not modelled."""
FINE_EDGE = 0.004
"""Mean edge length below which the mesh is fine enough for the skin texture (m)."""
MOST_FACES = 400_000
"""Number of faces above which a head is not subdivided further."""


def fine_mesh(head: Head) -> tuple[Mesh, Float[Tensor, " vertex"]]:
    """Subdivide the surface, and compute the share of scalp at each vertex (1 within it, fading at its edge)."""
    vertices, faces = head.mesh.vertices, head.mesh.faces
    on_scalp = torch.zeros(len(faces), dtype=torch.bool, device=faces.device)
    on_scalp[head.scalp_faces] = True
    while len(faces) * 4 <= MOST_FACES and _mean_edge(vertices, faces) > FINE_EDGE:
        vertices, faces = _divided(vertices, faces)
        on_scalp = on_scalp.repeat(4)
    bare = torch.zeros(len(vertices), device=vertices.device)
    bare[faces[~on_scalp].reshape(-1)] = 1.0
    share = 1.0 - bare
    for _ in range(6):
        share = share * _neighbour_mean(share, faces)
    return Mesh(vertices, faces), share


def skin_colours(
    vertices: Float[Tensor, "vertex 3"],
    scalp_share: Float[Tensor, " vertex"],
    hair: Float[Tensor, "3"],
    generator: torch.Generator,
) -> Float[Tensor, "vertex 3"]:
    """Linear albedo of the skin: mottled, redder in patches, darkened by hair on the scalp."""
    tone = smooth_noise(vertices, 0.02, generator) + 0.6 * smooth_noise(vertices, 0.007, generator)
    blush = smooth_noise(vertices, 0.045, generator)
    base = vertices.new_tensor(SKIN)
    colour = base * (1 + 0.07 * tone[:, None])
    colour = colour * (1 + blush[:, None] * vertices.new_tensor([0.02, -0.07, -0.06]))
    shade = SCALP_SHADE * scalp_share[:, None]
    return (colour * (1 - shade) + (0.8 * hair + 0.1 * base) * shade).clamp(0.01, 0.95)


def surround(height: int, generator: torch.Generator) -> Float[Tensor, "{height} width 3"]:
    """An environment of soft coloured clouds, brighter above: latitude by longitude, linear radiance."""
    latitude = math.pi * (torch.arange(height) + 0.5) / height
    longitude = 2 * math.pi * (torch.arange(2 * height) + 0.5) / (2 * height)
    theta, phi = torch.meshgrid(latitude, longitude, indexing="ij")
    directions = torch.stack([theta.sin() * phi.sin(), theta.cos(), theta.sin() * phi.cos()], dim=-1)
    clouds = [smooth_noise(directions.reshape(-1, 3), size, generator).reshape(theta.shape) for size in (0.8, 0.35)]
    tint = smooth_noise(directions.reshape(-1, 3), 0.7, generator).reshape(theta.shape)
    level = 0.42 + 0.14 * directions[..., 1] + 0.075 * clouds[0] + 0.035 * clouds[1]
    warm = torch.tensor([0.10, 0.01, -0.12])
    return (level[..., None] * (1 + tint[..., None] * warm) * torch.tensor([0.96, 1.0, 1.05])).clamp(min=0.02)


def smooth_noise(points: Float[Tensor, "point 3"], size: float, generator: torch.Generator) -> Float[Tensor, " point"]:
    """Value noise of unit standard deviation at the nodes of a lattice of `size` metres, cubically interpolated."""
    cell = points / size
    low = cell.amin(dim=0).floor()
    place = cell - low
    sizes = [int(extent) + 2 for extent in place.amax(dim=0).tolist()]
    lattice = torch.randn(sizes, generator=generator, device=generator.device).to(points)
    corner = place.floor().long()
    blend = smoothstep(place - corner)
    total = points.new_zeros(len(points))
    for offset in range(8):
        bits = torch.tensor([offset & 1, offset >> 1 & 1, offset >> 2 & 1], device=points.device)
        weight = torch.where(bits == 1, blend, 1 - blend).prod(dim=-1)
        total = total + weight * lattice[tuple((corner + bits).unbind(dim=-1))]
    return total


def _mean_edge(vertices: Float[Tensor, "vertex 3"], faces: Tensor) -> float:
    corners = vertices[faces]
    return float((corners - corners.roll(1, dims=1)).norm(dim=-1).mean())


def _divided(vertices: Float[Tensor, "vertex 3"], faces: Tensor) -> tuple[Tensor, Tensor]:
    """Split each triangle into four at the midpoints of its edges; child k of face f is face k * F + f."""
    edges = torch.stack([faces, faces.roll(-1, dims=1)], dim=-1).reshape(-1, 2).sort(dim=-1).values
    unique, index = torch.unique(edges, dim=0, return_inverse=True)
    middle = index.reshape(-1, 3) + len(vertices)
    a, b, c = faces.unbind(dim=1)
    ab, bc, ca = middle.unbind(dim=1)
    children = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    divided = torch.cat([torch.stack(child, dim=1) for child in children])
    return torch.cat([vertices, vertices[unique].mean(dim=1)]), divided


def _neighbour_mean(values: Float[Tensor, " vertex"], faces: Tensor) -> Float[Tensor, " vertex"]:
    total, count = torch.zeros_like(values), torch.zeros_like(values)
    for corner in range(3):
        for other in range(3):
            total = total.index_add(0, faces[:, corner], values[faces[:, other]])
            count = count.index_add(0, faces[:, corner], torch.ones_like(values[faces[:, other]]))
    return total / count.clamp(min=1.0)
