"""The sine layers against closed forms."""

import math
from dataclasses import replace

import pytest
import torch

from neural_strands.prior.synthesiser import Modulations, Synthesiser, SynthesiserConfig, positions, times

CONFIG = SynthesiserConfig(carriers=6, smooth=3, sidebands=1)


def circle(frequency: float, config: SynthesiserConfig = CONFIG, warp: float = 0.0) -> Modulations:
    """dp/dt = 2 (cos(w (t - 1/2)), sin(w (t - 1/2)), 0): a circle of radius 2 / w."""
    unit = torch.zeros(1, 3, 2)
    unit[0, 0, 1], unit[0, 1, 0] = 1.0, 1.0
    return Modulations(
        length=torch.full((1,), 2.0),
        carrier_amplitude=torch.zeros(1, 3, config.carriers),
        unit_amplitude=unit,
        frequency=torch.full((1, 2), frequency),
        warp=torch.full((1, 1), warp),
    )


def layers(config: SynthesiserConfig = CONFIG) -> Synthesiser:
    return Synthesiser(config).requires_grad_(False)


@pytest.mark.parametrize("points", [7, 25, 100, 400])
def test_a_circle_is_exact_at_any_number_of_points(points: int) -> None:
    # p(t) = 2/w (sin(w(t-1/2)) + sin(w/2), cos(w/2) - cos(w(t-1/2)), 0)
    w = 9.0
    turn = w * (torch.linspace(0, 1, points) - 0.5)
    x = 2 / w * (turn.sin() + math.sin(w / 2))
    y = 2 / w * (math.cos(w / 2) - turn.cos())
    expected = torch.stack([x, y, torch.zeros(points)], dim=-1)
    torch.testing.assert_close(layers()(circle(w), points)[0], expected, atol=2e-6, rtol=0)


def test_euler_converges_to_the_exact_sum_with_the_square_of_the_step() -> None:
    euler = layers(replace(CONFIG, integration="euler"))
    gaps = [float((euler(circle(9.0), points) - layers()(circle(9.0), points)).abs().max()) for points in (21, 41, 81)]
    assert gaps[0] / gaps[1] == pytest.approx(4, rel=0.1)
    assert gaps[1] / gaps[2] == pytest.approx(4, rel=0.1)


def test_the_constant_carrier_gives_a_straight_strand() -> None:
    modulations = circle(9.0)
    amplitude = torch.zeros(1, 3, CONFIG.carriers)
    # The first carrier is sin(0 t + pi / 2) = 1.
    amplitude[0, 2, 0] = 1.0
    straight = replace(modulations, unit_amplitude=torch.zeros(1, 3, 2), carrier_amplitude=amplitude)
    strand = layers()(straight, 5)[0]
    torch.testing.assert_close(strand, torch.tensor([0.0, 0.0, 2.0]) * torch.linspace(0, 1, 5)[:, None])


def test_warp_shifts_the_phase_by_the_warp_functions() -> None:
    layer = layers()
    t = times(100, "gradient", layer.carrier_frequency)
    shift = 0.3 * (layer.warp_mix @ layer.carriers(t, None))[0]
    steps = layer.steps(circle(9.0, warp=0.3), 100)[0]
    factor = math.sin(4.5 / 99) / (4.5 / 99)
    expected = 2 / 99 * factor * torch.stack([(9 * (t - 0.5) + shift).cos(), (9 * (t - 0.5) + shift).sin()])
    torch.testing.assert_close(steps[:2], expected, atol=1e-6, rtol=0)


def test_position_output_is_what_the_sines_say_moved_to_the_root() -> None:
    layer = layers(replace(CONFIG, output="position"))
    turn = 9.0 * (torch.linspace(0, 1, 30) - 0.5)
    expected = 2 * torch.stack([turn.cos() - turn[0].cos(), turn.sin() - turn[0].sin(), torch.zeros(30)], dim=-1)
    torch.testing.assert_close(layer(circle(9.0), 30)[0], expected, atol=1e-5, rtol=0)


def test_positions_sum_offsets_from_the_root() -> None:
    steps = torch.rand(2, 3, 4)
    strand = positions(steps, "gradient")
    assert strand.shape == (2, 5, 3)
    assert (strand[:, 0] == 0).all()
    torch.testing.assert_close(strand[:, 3], steps[..., :3].sum(dim=-1))
