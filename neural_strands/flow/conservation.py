"""Directions that conserve hair: the flow into every voxel equals the flow out of it.

Streamlines of merely smooth directions crowd near the scalp and leave the outer half of the hair empty. Real hair
cannot do that: strands leave the scalp, and each takes up space until its tip. So the hair is modelled as a steady flow
without divergence: in through the scalp, out where it leaves the volume lengthways, and along the hull elsewhere. Its
speed, which is the density of the hair, is free; its directions stay as close as possible to the given ones.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.faces import behind_faces, face_neighbours, neighbour_sum
from neural_strands.flow.field import FlowField
from neural_strands.flow.surface import surface_normals
from neural_strands.foundation.configs import Between
from neural_strands.foundation.progress import Track, untracked
from neural_strands.geometry.voxel_grid import VoxelGrid


@dataclass(frozen=True)
class ConservationConfig:
    """The alternating projections and their solver."""

    rounds: Annotated[int, Between(0, 100)] = 4
    """Number of projections onto flows without divergence, with projections onto the given directions in between; 0
    leaves the directions unchanged."""
    least_speed: Annotated[float, Between(0, 1)] = 0.2
    """Smallest speed after the second projection, as a share of the mean; a flow at rest has no direction."""
    most_speed: Annotated[float, Between(1, 1e6)] = 5.0
    """Largest speed after the second projection, as a share of the mean."""
    way_out: Annotated[float, Between(-1, 1)] = 0.1
    """Hair leaves the volume where the cosine between its direction and the normal of the volume exceeds this."""
    tolerance: Annotated[float, Between(1e-9, 1)] = 0.01
    """Divergence at which a projection ends, as a share of the divergence before the first."""
    iterations: Annotated[int, Between(1, 1_000_000)] = 400
    """Largest number of conjugate gradient steps in a projection."""


@dataclass(frozen=True)
class FlowCells:
    """The voxels of the domain, numbered, and their faces in the order +x, +y, +z, -x, -y, -z.

    Attributes:
        neighbours: cell behind each face; the number of cells where there is none.
        open: faces without a neighbouring cell through which hair passes: from the scalp, or out of the volume.
        scalp: those of them that hair comes through from the scalp.
    """

    neighbours: Int64[Tensor, "cell 6"]
    open: Bool[Tensor, "cell 6"]
    scalp: Bool[Tensor, "cell 6"]

    @property
    def inner(self) -> Bool[Tensor, "cell 6"]:
        """Faces between two cells."""
        return self.neighbours < len(self.neighbours)

    @property
    def linked(self) -> Bool[Tensor, "cell 6"]:
        """Faces that flow can pass."""
        return self.open | self.inner


def conserve(
    field: FlowField,
    scalp_points: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    depth: float,
    config: ConservationConfig | None = None,
    walls: Bool[Tensor, "x y z"] | None = None,
    track: Track = untracked,
) -> FlowField:
    """Rotate the directions of a field as little as possible so that hair from the scalp fills the domain.

    Measured directions take part but are restored at the end: empty space between the hair and the masks' hull must not
    bend the hair.

    Args:
        field: unit directions everywhere, and the domain of hair.
        scalp_points: a dense sample of the scalp.
        scalp_normals: its outward normals.
        depth: how far below the scalp the domain reaches, metres.
        config: weights and limits.
        walls: voxels outside the domain that hair does not run into; those of the scalp do not count.
        track: shows the progress of the rounds.
    """
    config = config or ConservationConfig()
    if config.rounds == 0 or not bool(field.domain.any()):
        return field
    number = torch.nonzero(field.domain.reshape(-1)).squeeze(1)
    given = functional.normalize(field.directions.reshape(-1, 3)[number], dim=1)
    scalp = under_scalp(field.grid, scalp_points, scalp_normals, depth) & ~field.domain
    centres = field.grid.nodes(given.device).reshape(-1, 3)[number]
    normals = surface_normals(field.grid, field.domain, centres)
    cells = flow_cells(field.domain, scalp, given, normals, config.way_out)
    if walls is not None:
        closed = behind_faces(walls, field.domain, False) & ~cells.scalp
        cells = replace(cells, open=cells.open & ~closed)
    enough = config.tolerance * float(face_flow(given, cells).sum(dim=1).norm())
    flow, speed = given, torch.ones_like(given[:, 0])
    for _ in track(range(config.rounds), "spreading hair over its room", config.rounds):
        faces = without_divergence(face_flow(speed[:, None] * given, cells), cells, enough, config.iterations)
        flow = 0.5 * (faces[:, :3] - faces[:, 3:])
        speed = (flow * given).sum(dim=1)
        speed = (speed / speed.mean().clamp(min=1e-6)).clamp(config.least_speed, config.most_speed)
        # No hair grows into the scalp.
        cells = replace(cells, open=cells.open & ~(cells.scalp & (faces > 0)))
    turned = flow.norm(dim=1, keepdim=True) > 1e-6
    if field.measured is not None:
        turned = turned & ~field.measured.reshape(-1, 1)[number]
    kept = torch.where(turned, functional.normalize(flow, dim=1), given)
    directions = field.directions.reshape(-1, 3).index_copy(0, number, kept).reshape_as(field.directions)
    return replace(field, directions=directions)


def under_scalp(
    grid: VoxelGrid, points: Float[Tensor, "root 3"], normals: Float[Tensor, "root 3"], depth: float
) -> Bool[Tensor, "x y z"]:
    """Voxels at the scalp, down to two voxels below the depth at which the domain of hair ends."""
    marked = torch.zeros(grid.count, dtype=torch.bool, device=points.device)
    for below in torch.arange(0.0, depth + 2 * grid.spacing, 0.5 * grid.spacing).tolist():
        index, inside = grid.index(points - below * normals)
        marked[index[inside]] = True
    # Roots are a voxel or two apart.
    wide = functional.max_pool3d(marked.reshape(1, 1, *grid.shape).float(), 3, stride=1, padding=1)
    return wide[0, 0] > 0


def flow_cells(
    domain: Bool[Tensor, "x y z"],
    scalp: Bool[Tensor, "x y z"],
    directions: Float[Tensor, "cell 3"],
    normals: Float[Tensor, "cell 3"],
    way_out: float,
) -> FlowCells:
    """Number the domain's voxels and find the faces that hair passes.

    Whether hair leaves the domain depends on the normal of its smooth surface, not on that of a face: a sloping surface
    is a staircase of voxels, and hair that follows it runs against the stairs.

    Args:
        domain: where there is hair.
        scalp: voxels outside the domain that hair comes from.
        directions: unit directions of the domain's voxels.
        normals: unit directions out of the domain.
        way_out: cosine with the normal beyond which hair leaves through the faces that it points to.
    """
    neighbours = face_neighbours(domain)
    outward = torch.cat([directions, -directions], dim=1)
    leaving = (directions * normals).sum(dim=1) > way_out
    free = neighbours == len(neighbours)
    rooted = behind_faces(scalp, domain, False) & free
    return FlowCells(neighbours, rooted | (leaving[:, None] & (outward > 0) & free), rooted)


def face_flow(flow: Float[Tensor, "cell 3"], cells: FlowCells) -> Float[Tensor, "cell 6"]:
    """Outward flow through the faces of cells: the mean of both sides; zero through closed faces."""
    outward = torch.cat([flow, -flow], dim=1)
    beyond = torch.cat([outward, outward.new_zeros(1, 6)]).gather(0, cells.neighbours)
    return torch.where(cells.inner, 0.5 * (outward + beyond), outward * cells.open)


def without_divergence(
    faces: Float[Tensor, "cell 6"], cells: FlowCells, enough: float, iterations: int
) -> Float[Tensor, "cell 6"]:
    """Project a flow through faces onto the nearest one that sums to zero over every cell (Helmholtz projection).

    Solves Poisson's equation for a pressure, zero beyond open faces, by conjugate gradients (Jacobi preconditioned),
    and subtracts its differences from the flow.

    Args:
        faces: outward flow; equal and opposite on the two sides of a face.
        cells: neighbours and open faces.
        enough: norm of the divergence below which the solver stops.
        iterations: largest number of steps of the solver.
    """
    linked = cells.linked
    degree = linked.sum(dim=1).to(faces)
    inverse = torch.where(degree > 0, 1 / degree.clamp(min=1), torch.zeros_like(degree))

    def behind(pressure: Float[Tensor, " cell"]) -> Float[Tensor, "cell 6"]:
        return torch.cat([pressure, pressure.new_zeros(1)])[cells.neighbours]

    pressure = torch.zeros_like(degree)
    residual = torch.where(degree > 0, -faces.sum(dim=1), torch.zeros_like(degree))
    step = inverse * residual
    product = residual @ step
    for _ in range(iterations):
        if not float(residual.norm()) > enough:
            break
        applied = degree * step - neighbour_sum(step[:, None], cells.neighbours)[:, 0]
        length = product / (step @ applied)
        pressure, residual = pressure + length * step, residual - length * applied
        before, product = product, residual @ (inverse * residual)
        step = inverse * residual + (product / before) * step
    return faces + (pressure[:, None] - behind(pressure)) * linked
