"""Flows that conserve hair against a dense least-squares solve, and strands against the space that they should fill."""

from dataclasses import replace

import torch

from neural_strands.flow.conservation import (
    ConservationConfig,
    FlowCells,
    conserve,
    face_flow,
    flow_cells,
    under_scalp,
    without_divergence,
)
from neural_strands.flow.field import FlowField
from neural_strands.flow.surface import surface_normals
from neural_strands.flow.tracing import TraceConfig, trace_strands
from neural_strands.geometry.voxel_grid import VoxelGrid

UP = torch.tensor([0.0, 1.0, 0.0])


def ragged(generator: torch.Generator) -> tuple[FlowCells, torch.Tensor]:
    domain = torch.rand(5, 4, 4, generator=generator) > 0.25
    scalp = torch.zeros_like(domain)
    scalp[:, 0] = True
    directions, normals = torch.nn.functional.normalize(
        torch.randn(2, int(domain.sum()), 3, generator=generator), dim=2
    )
    return flow_cells(domain, scalp & ~domain, directions, normals, 0.5), directions


def over_flat_scalp(shape: tuple[int, int, int]) -> tuple[VoxelGrid, torch.Tensor, torch.Tensor]:
    """A full box of unit voxels over a layer that is scalp, and roots on the border between them."""
    width, height, depth = shape
    grid = VoxelGrid((0.5, -0.5, 0.5), 1.0, (width, height + 1, depth))
    domain = torch.ones(grid.shape, dtype=torch.bool)
    domain[:, 0] = False
    x, z = torch.meshgrid(torch.arange(width) + 0.5, torch.arange(depth) + 0.5, indexing="ij")
    return grid, domain, torch.stack([x, torch.full_like(x, -0.01), z], dim=-1).reshape(-1, 3)


def free_flows(cells: FlowCells) -> torch.Tensor:
    """Unit flows through one face each, faces between cells once: a basis of all flows, (face, cell, 6)."""
    count, basis = len(cells.neighbours), []
    for cell in range(count):
        for face in range(6):
            other = int(cells.neighbours[cell, face])
            one = torch.zeros(count, 6, dtype=torch.float64)
            one[cell, face] = 1.0
            if other < count:
                one[other, (face + 3) % 6] = -1.0
            if bool(cells.open[cell, face]) or (other < count and face < 3):
                basis.append(one)
    return torch.stack(basis)


def test_flow_through_faces_is_the_mean_of_both_sides_and_none_through_walls(generator):
    cells, directions = ragged(generator)
    faces = face_flow(directions, cells)
    for cell in range(len(directions)):
        for face in range(6):
            axis, sign = face % 3, 1.0 if face < 3 else -1.0
            other = int(cells.neighbours[cell, face])
            own = sign * directions[cell, axis]
            if other < len(directions):
                expected = 0.5 * (own + sign * directions[other, axis])
            else:
                expected = own if bool(cells.open[cell, face]) else torch.tensor(0.0)
            torch.testing.assert_close(faces[cell, face], expected)


def test_hair_along_a_slope_does_not_leave_through_its_stairs():
    # The lower side of this volume slopes; hair that runs along it points out of the lower faces of its stairs.
    grid = VoxelGrid.filling((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05), 0.002)
    outward = torch.nn.functional.normalize(torch.tensor([1.0, -0.75, 0.0]), dim=0)
    domain = (grid.nodes() @ outward < 0) & (grid.nodes().abs() < 0.04).all(dim=-1)
    along = torch.tensor([-0.6, -0.8, 0.0])
    assert abs(float(along @ outward)) < 1e-6
    centres = grid.nodes()[domain]
    slope = (centres @ outward > -0.003) & (centres.abs() < 0.02).all(dim=1)
    normals = surface_normals(grid, domain, centres)

    def leaving(direction: torch.Tensor) -> torch.Tensor:
        directions = direction.expand(len(centres), 3)
        return flow_cells(domain, torch.zeros_like(domain), directions, normals, 0.2).open[slope]

    assert int(slope.sum()) > 200
    assert not leaving(along).any()
    # Straight down, hair leaves through the lower faces (-y) of the stairs alone.
    down = leaving(torch.tensor([0.0, -1.0, 0.0]))
    assert down[:, 4].float().mean() > 0.3
    assert not down[:, [0, 1, 2, 3, 5]].any()


def test_projection_is_the_nearest_flow_without_divergence(generator):
    cells, directions = ragged(generator)
    faces = face_flow(directions.double(), cells)
    ours = without_divergence(faces, cells, 1e-10, 500)
    closed = cells.linked.sum(dim=1) == 0
    assert float(ours.sum(dim=1)[~closed].abs().max()) < 1e-8
    # An independent solution: minimise the distance within the null space of the divergence.
    basis = free_flows(cells)
    kept = basis.flatten(1).norm(dim=1) > 0
    basis = basis[kept]
    amounts = torch.linalg.lstsq(basis.flatten(1).T, faces.flatten()[:, None]).solution[:, 0]
    # Faces between cells appear twice in a flow, open ones once; the projection weighs every face once.
    divergence = basis.sum(dim=2).T
    change = torch.linalg.pinv(divergence) @ (divergence @ amounts)
    expected = torch.einsum("f,fck->ck", amounts - change, basis)
    torch.testing.assert_close(ours, expected, atol=1e-7, rtol=0)


def test_a_flow_that_conserves_hair_already_is_left_alone():
    grid, domain, roots = over_flat_scalp((4, 8, 4))
    field = FlowField(grid, UP.expand(*grid.shape, 3), domain)
    # Both ends are open: hair enters through the scalp and leaves along the direction.
    kept = conserve(field, roots, UP.expand(len(roots), 3), 0.0)
    torch.testing.assert_close(kept.directions, field.directions, atol=1e-5, rtol=0)


def test_strands_from_a_scalp_fill_the_room_above_it():
    # A slab of hair, 12 mm high, over a flat scalp; all of it points along the scalp, slightly upwards.
    spacing = 0.001
    grid = VoxelGrid((0.0005, -0.0015, 0.0005), spacing, (80, 16, 8))
    centres = grid.nodes()
    domain = (centres[..., 1] > 0) & (centres[..., 1] < 0.012) & (centres[..., 0] > 0.002)
    along = torch.nn.functional.normalize(torch.tensor([1.0, 0.05, 0.0]), dim=0)
    field = FlowField(grid, along.expand(*grid.shape, 3), domain)
    x, z = torch.meshgrid(torch.arange(0.003, 0.06, 0.001), torch.arange(0.0005, 0.008, 0.001), indexing="ij")
    roots = torch.stack([x, torch.full_like(x, 1e-4), z], dim=-1).reshape(-1, 3)
    normals = UP.expand(len(roots), 3)
    trace = TraceConfig(step=0.0005, longest=0.1, shortest=0.001, grace=0.001, points=60)

    def upper_half(rounds: int) -> float:
        filled = conserve(field, roots, normals, 0.0, ConservationConfig(rounds=rounds))
        strands = trace_strands(filled, roots, normals, trace)
        # Each strand counts once, whatever its length: its height where it crosses the middle of the window.
        beyond = strands[..., 0] > 0.07
        crossing = strands[torch.arange(len(strands)), beyond.int().argmax(dim=1), 1][beyond.any(dim=1)]
        assert len(crossing) > 100
        return float((crossing > 0.006).float().mean())

    # More rounds spread strands more evenly: half of them belong in the upper half of the space.
    assert upper_half(0) == 0.0
    assert upper_half(0) < upper_half(1) < upper_half(4) < upper_half(12)
    assert 0.3 < upper_half(12) < 0.6


def test_hair_does_not_end_in_the_scalp():
    """A slab over a flat scalp, open at its far end, whose directions lead a little into the scalp."""
    grid, domain, roots = over_flat_scalp((60, 8, 3))
    given = torch.nn.functional.normalize(torch.tensor([1.0, -0.15, 0.0]), dim=0)
    field, normals = FlowField(grid, given.expand(*grid.shape, 3), domain), UP.expand(len(roots), 3)
    filled = conserve(field, roots, normals, 0.0, ConservationConfig(rounds=12, way_out=0.5))
    next_to_scalp = filled.directions[2:50, 1]
    assert float(next_to_scalp[..., 1].min()) > -0.02


def test_hair_does_not_run_into_walls():
    """A slab that hair crosses slantwise, with a ceiling that is a wall or open, and open at its far side."""
    grid, domain, roots = over_flat_scalp((40, 9, 3))
    walls = torch.zeros_like(domain)
    walls[:, -1] = True
    slantwise = torch.nn.functional.normalize(torch.tensor([1.0, 1.0, 0.0]), dim=0)
    field = FlowField(grid, slantwise.expand(*grid.shape, 3), domain & ~walls)
    config = ConservationConfig(rounds=12, way_out=0.5)
    open_above, below_wall = (
        conserve(field, roots, UP.expand(len(roots), 3), 0.0, config, given).directions[5:35, -2, :, 1]
        for given in (None, walls)
    )
    assert float(open_above.min()) > 0.5
    assert float(below_wall.max()) < 0.25


def test_directions_turn_less_when_speed_is_free(generator):
    grid, domain, roots = over_flat_scalp((12, 6, 12))
    centres = grid.nodes() - torch.tensor([6.0, -2.0, 6.0])
    directions = torch.nn.functional.normalize(centres, dim=-1)
    field = FlowField(grid, directions, domain)

    def turned(rounds: int) -> float:
        config = ConservationConfig(rounds=rounds, way_out=0.5)
        kept = conserve(field, roots, UP.expand(len(roots), 3), 0.0, config).directions
        return float((kept - directions).square().sum(dim=-1).mean())

    assert turned(0) == 0.0
    assert turned(6) < 0.6 * turned(1)


def test_measured_directions_alone_are_kept(generator):
    grid, domain, roots = over_flat_scalp((12, 6, 12))
    directions = torch.nn.functional.normalize(grid.nodes() - torch.tensor([6.0, -2.0, 6.0]), dim=-1)
    measured = (torch.rand(grid.shape, generator=generator) < 0.2) & domain
    field, normals = FlowField(grid, directions, domain), UP.expand(len(roots), 3)
    free, held = (conserve(replace(field, measured=mask), roots, normals, 0.0) for mask in (None, measured))
    torch.testing.assert_close(held.directions[measured], directions[measured])
    assert not torch.allclose(free.directions[measured], directions[measured], atol=1e-3)
    assert torch.equal(held.directions[~measured], free.directions[~measured])


def test_voxels_under_the_scalp_reach_below_the_domain():
    grid = VoxelGrid((0.5, 0.5, 0.5), 1.0, (5, 8, 5))
    marked = under_scalp(grid, torch.tensor([[2.5, 6.5, 2.5]]), UP[None], 1.0)
    column = marked[2, :, 2]
    # From the root, in voxel 6, to 2.5 voxels below it, and one voxel around that.
    assert column.tolist() == [False, False, False, True, True, True, True, True]
    assert not bool(marked[0].any() or marked[:, :, 4].any())


def test_an_empty_domain_stays_as_it_is():
    grid = VoxelGrid((0.5, 0.5, 0.5), 1.0, (3, 3, 3))
    field = FlowField(grid, torch.ones(3, 3, 3, 3), torch.zeros(3, 3, 3) > 0)
    assert conserve(field, torch.zeros(1, 3), UP[None], 0.0) is field
