"""The density of hair on a grid: closed forms for a block of strands, and invariants."""

import pytest
import torch

from neural_strands.model.hair_volume import CHANNELS, FAINT, hair_volume


def block(spacing: float = 0.002, side: float = 0.12) -> torch.Tensor:
    """Straight strands along x, `side` metres long, on a square lattice of y and z."""
    lattice = torch.arange(0, side, spacing)
    y, z = torch.meshgrid(lattice, lattice, indexing="ij")
    x = torch.linspace(0, side, 33)
    return torch.stack(
        [x.expand(y.numel(), -1), y.reshape(-1, 1).expand(-1, 33), z.reshape(-1, 1).expand(-1, 33)], dim=-1
    )


def test_inside_a_block_density_is_strands_a_square_millimetre(generator):
    """The mean around the middle, because a lattice of 2 mm interferes with the grid's cells."""
    places = 0.06 + 0.03 * (torch.rand(500, 3, generator=generator) - 0.5)
    density = hair_volume(block()).at(places)[:, 3:].exp() - FAINT
    torch.testing.assert_close(density.mean(dim=0), torch.full((2,), 1 / 2.0**2), atol=0.0, rtol=0.03)


def test_density_does_not_depend_on_how_strands_are_sampled():
    strands = block()
    middle = torch.full((1, 3), 0.06)
    torch.testing.assert_close(
        hair_volume(strands[:, ::4]).at(middle), hair_volume(strands).at(middle), atol=0.05, rtol=0
    )


def test_out_of_a_ball_is_along_its_radius(generator):
    towards = torch.nn.functional.normalize(torch.randn(4000, 3, generator=generator), dim=1)
    strands = towards[:, None] * torch.linspace(0.03, 0.1, 20)[:, None]
    found = hair_volume(strands).at(0.1 * towards[:200])
    assert (found[:, :3] * towards[:200]).sum(dim=1).min() > 0.9
    torch.testing.assert_close(found[:, :3].norm(dim=1), torch.ones(200))


def test_the_rim_is_fainter_than_the_middle():
    middle, edge, outside = hair_volume(block()).at(
        torch.tensor([[0.06, 0.06, 0.06], [0.06, 0.0, 0.06], [0.06, -0.03, 0.06]])
    )
    # Half of a Gaussian around a point on the surface lies in the block.
    torch.testing.assert_close(edge[3:].exp() - FAINT, 0.5 * (middle[3:].exp() - FAINT), atol=0.03, rtol=0)
    assert (outside[3:] < edge[3:]).all()
    torch.testing.assert_close(edge[:3], torch.tensor([0.0, -1.0, 0.0]), atol=0.1, rtol=0)


def test_it_moves_with_the_hair(generator):
    strands = block() + 1e-4 * torch.randn(3600, 33, 3, generator=generator)
    places = 0.12 * torch.rand(50, 3, generator=generator)
    step = torch.tensor([0.5, -0.25, 1.0])
    torch.testing.assert_close(
        hair_volume(strands + step).at(places + step), hair_volume(strands).at(places), atol=0.05, rtol=0
    )


@pytest.mark.parametrize("count", [0, 3])
def test_no_hair_and_broken_hair_are_empty(count):
    found = hair_volume(torch.full((count, 10, 3), float("nan"))).at(torch.zeros(2, 3))
    assert found.shape == (2, CHANNELS)
    assert found.isfinite().all()


def test_broken_strands_do_not_count():
    strands = block()
    broken = torch.cat([strands, torch.full_like(strands[:5], float("nan"))])
    places = torch.rand(20, 3) * 0.12
    torch.testing.assert_close(hair_volume(broken).at(places), hair_volume(strands).at(places))


def test_hair_of_any_size_fits_the_grid():
    wide = hair_volume(torch.tensor([[[0.0, 0.0, 0.0], [0.0, 100.0, 0.0]]]))
    assert wide.values.numel() < 1_000_000
    assert wide.at(torch.tensor([[0.0, 50.0, 0.0]])).isfinite().all()


def test_positions_get_no_gradient():
    world = torch.full((1, 3), 0.05, requires_grad=True)
    assert not hair_volume(block()).at(world).requires_grad


def test_two_states_of_hair_can_share_their_nodes():
    whole = block()
    first = hair_volume(whole)
    half = hair_volume(whole[: len(whole) // 2] + 0.0123, first.grid)
    assert half.grid.spacing == first.grid.spacing
    steps = [(a - b) / first.grid.spacing for a, b in zip(half.grid.origin, first.grid.origin, strict=True)]
    assert steps == pytest.approx([round(step) for step in steps], abs=1e-4)
    # Hair that has become far larger gets cells of its own.
    assert hair_volume(20 * whole, first.grid).grid.spacing > 2 * first.grid.spacing
