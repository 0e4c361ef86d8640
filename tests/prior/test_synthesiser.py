"""The sine layers against closed forms."""

import math
from dataclasses import replace

import pytest
import torch

from neural_strands.prior.blocks import BLOCK
from neural_strands.prior.synthesiser import (
    Modulation,
    Modulations,
    Output,
    Synthesiser,
    SynthesiserConfig,
    positions,
    times,
)

CONFIG = SynthesiserConfig(carriers=6, smooth=3, sidebands=1)


def circle(frequency: float, config: SynthesiserConfig = CONFIG, warp: float = 0.0) -> Modulations:
    """dp/dt = 2 (cos(w (t - 1/2)), sin(w (t - 1/2)), 0): a circle of radius 2 / w."""
    unit = torch.zeros(1, 3, 2)
    unit[0, 0, 1], unit[0, 1, 0] = 1.0, 1.0
    return Modulations(
        length=torch.full((1,), 2.0),
        smooth=torch.zeros(1, 3, config.smooth),
        unit_amplitude=unit,
        frequency=torch.full((1,), frequency),
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
    smooth = torch.zeros(1, 3, CONFIG.smooth)
    # The first smooth function is the first carrier, sin(0 t + pi / 2) = 1.
    smooth[0, 2, 0] = 1.0
    straight = replace(modulations, unit_amplitude=torch.zeros(1, 3, 2), smooth=smooth)
    strand = layers()(straight, 5)[0]
    torch.testing.assert_close(strand, torch.tensor([0.0, 0.0, 2.0]) * torch.linspace(0, 1, 5)[:, None])


def test_warp_shifts_the_phase_by_the_warp_functions() -> None:
    layer = layers()
    t = times(100, "gradient", layer.carrier_frequency)
    shift = 0.3 * (layer.warp_mix @ layer.carriers(t, None))[0]
    strand = layer(circle(9.0, warp=0.3), 100)[0]
    factor = math.sin(4.5 / 99) / (4.5 / 99)
    expected = 2 / 99 * factor * torch.stack([(9 * (t - 0.5) + shift).cos(), (9 * (t - 0.5) + shift).sin()])
    torch.testing.assert_close(strand.diff(dim=0)[:, :2].T, expected, atol=1e-6, rtol=0)


def test_position_output_is_what_the_sines_say_moved_to_the_root() -> None:
    layer = layers(replace(CONFIG, output="position"))
    turn = 9.0 * (torch.linspace(0, 1, 30) - 0.5)
    expected = 2 * torch.stack([turn.cos() - turn[0].cos(), turn.sin() - turn[0].sin(), torch.zeros(30)], dim=-1)
    torch.testing.assert_close(layer(circle(9.0), 30)[0], expected, atol=1e-5, rtol=0)


def test_positions_sum_offsets() -> None:
    offsets = torch.rand(2, 3, 5)
    strand = positions(offsets, "gradient")
    assert strand.shape == (2, 5, 3)
    torch.testing.assert_close(strand[:, 3], offsets[..., :4].sum(dim=-1))


@pytest.mark.parametrize("modulation", ["all", "amplitude"])
@pytest.mark.parametrize("output", ["gradient", "position"])
def test_strands_are_the_sum_of_their_sines(modulation: Modulation, output: Output) -> None:
    random = torch.Generator().manual_seed(0)
    config = SynthesiserConfig(carriers=6, smooth=3, sidebands=2, warps=2, output=output, modulation=modulation)
    layer = layers(config)
    for parameter in layer.parameters():
        parameter += 0.3 * torch.randn(parameter.shape, generator=random)
    # More strands than fit in a block, and not a multiple of it.
    count = BLOCK + 3
    given = Modulations(
        length=torch.rand(count, generator=random),
        smooth=torch.randn(count, 3, config.smooth, generator=random),
        unit_amplitude=torch.randn(count, 3, config.units, generator=random),
        frequency=10 + 90 * torch.rand(count, generator=random),
        warp=torch.randn(count, config.warps, generator=random),
    )
    blocked = layer(given, 40)
    # Angles of 50 radians are known to 4e-6; positions are not divided by the number of steps.
    tolerance = 1e-5 if output == "gradient" else 1e-4
    torch.testing.assert_close(blocked, layer.reference(given, 40), atol=tolerance, rtol=0)
    with torch.enable_grad():
        torch.testing.assert_close(layer(given, 40), blocked, atol=tolerance, rtol=0)
    # The last strand, in double precision, sine by sine.
    exact, last = layers(config).double(), {name: value[-1:].double() for name, value in vars(given).items()}
    exact.load_state_dict({name: value.double() for name, value in layer.state_dict().items()})
    t = times(40, output, exact.carrier_frequency)
    steps = (last["smooth"][0] @ exact.smooth_mix) @ exact.carriers(t, 40)
    warp = last["warp"][0] @ exact.warp_mix @ exact.carriers(t, None)
    frequencies = exact.unit_frequencies(last["frequency"])[0]
    for unit, frequency in enumerate(frequencies):
        sine = (frequency * (t - 0.5) + warp + exact.unit_phase[unit]).sin() * exact.attenuation(frequency, 40)
        steps = steps + last["unit_amplitude"][0, :, unit, None] * sine
    strand = (float(last["length"]) * exact.step_size(40) * steps).T
    expected = strand - strand[:1] if output == "position" else torch.cat([torch.zeros(1, 3), strand.cumsum(dim=0)])
    torch.testing.assert_close(blocked[-1].double(), expected, atol=tolerance, rtol=0)
