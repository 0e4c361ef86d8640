"""The closed-form analysis against strands whose quantities are known."""

import math

import pytest
import torch

from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.analysis import (
    DIRECTION_WEIGHT,
    Analysis,
    analyse,
    metric,
    principal_functions,
    rows,
    solve_ridge,
)
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.generator import GeneratorConfig, StrandGenerator
from neural_strands.prior.synthesiser import Modulation, Output, SynthesiserConfig, times


@pytest.fixture(scope="module")
def fitted() -> StrandGenerator:
    """A generator with smooth functions, and raw quantities for latents."""
    net = StrandGenerator(GeneratorConfig(layers=0))
    with torch.no_grad():
        net.linear.weight.copy_(torch.eye(64))
        net.linear.bias.zero_()
        curves = synthetic_curves(500, torch.Generator().manual_seed(0))
        net.synthesiser.smooth_mix.copy_(principal_functions(net.synthesiser, curves))
    return net.requires_grad_(False)


def helix(radius: float, pitch: float, turns: float) -> torch.Tensor:
    t = torch.linspace(0, 1, 100)
    angle = 2 * math.pi * turns * t
    curve = torch.stack([radius * (angle.cos() - 1), radius * angle.sin(), pitch * turns * t], dim=-1)
    return curve[None]


@pytest.mark.parametrize("turns", [7.0, 9.3, 14.7, 20.2])
def test_the_frequency_of_a_helix_is_found(fitted: StrandGenerator, turns: float) -> None:
    strand = helix(0.004, 0.02, turns)
    frequency, warp, _, _ = Analysis(fitted, 100).solve(strand / lengths(strand)[:, None, None], 4)
    # Four pairs of sines half a turn apart stand about the frequency: it need not be the middle one.
    assert float(frequency) / (2 * math.pi) == pytest.approx(turns, abs=0.8)
    assert warp.abs().max() < 1.0
    # A helix lies in the span of the sines, save for what the carriers miss at the ends.
    decoded = fitted(analyse(fitted, strand, 4).flat())
    assert 1000 * (decoded - strand).norm(dim=-1).max() < 0.4


def test_a_straight_strand_has_no_curl(fitted: StrandGenerator) -> None:
    strand = torch.linspace(0, 0.2, 100)[:, None] * torch.tensor([[0.6, 0.0, 0.8]])
    raw = analyse(fitted, strand[None])
    assert raw.gain < -4
    assert 1000 * (fitted(raw.flat()) - strand).norm(dim=-1).max() < 0.2


def test_analysis_of_curves_is_exact_to_fractions_of_a_millimetre(fitted: StrandGenerator) -> None:
    curves = synthetic_curves(300, torch.Generator().manual_seed(5))
    error = 1000 * (fitted(analyse(fitted, curves).flat()) - curves).norm(dim=-1)
    assert error.mean() < 0.2


def test_a_step_of_refinement_lowers_the_error(fitted: StrandGenerator) -> None:
    curves = synthetic_curves(200, torch.Generator().manual_seed(6))
    errors = [
        float((fitted(analyse(fitted, curves, steps).flat()) - curves).norm(dim=-1).mean()) for steps in (0, 1, 3)
    ]
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("output", ["gradient", "position"])
@pytest.mark.parametrize("modulation", ["all", "amplitude"])
def test_every_kind_of_synthesiser_is_analysed(output: Output, modulation: Modulation) -> None:
    config = GeneratorConfig(layers=0, synthesiser=SynthesiserConfig(output=output, modulation=modulation))
    net = StrandGenerator(config).requires_grad_(False)
    curves = synthetic_curves(300, torch.Generator().manual_seed(0))
    net.linear.weight.copy_(torch.eye(64))
    net.linear.bias.zero_()
    net.synthesiser.smooth_mix.copy_(principal_functions(net.synthesiser, curves))
    error = 1000 * (net(analyse(net, curves).flat()) - curves).norm(dim=-1).mean()
    assert error < 1.5


def test_the_metric_is_the_root_of_positions_and_slopes(fitted: StrandGenerator, generator: torch.Generator) -> None:
    function = torch.randn(5, 99, generator=generator)
    whole = rows(fitted.synthesiser, function, 100)
    assert whole.shape == (5, 198)
    torch.testing.assert_close(whole[:, 99:], DIRECTION_WEIGHT * function)
    measured = (function @ metric(fitted.synthesiser, 100)).norm(dim=1)
    torch.testing.assert_close(measured, whole.norm(dim=1), rtol=1e-4, atol=1e-5)


def test_solve_ridge_agrees_with_least_squares(generator: torch.Generator) -> None:
    basis = torch.randn(4, 5, 40, generator=generator)
    target = torch.randn(4, 3, 40, generator=generator)
    expected = torch.linalg.lstsq(basis.transpose(1, 2), target.transpose(1, 2)).solution.transpose(1, 2)
    torch.testing.assert_close(solve_ridge(basis, target, 0.0), expected, atol=1e-4, rtol=1e-3)
    # Ridge regression is least squares with rows of sqrt(ridge) added.
    rows_added = torch.cat([basis.transpose(1, 2), 2.0 * torch.eye(5).expand(4, 5, 5)], dim=1)
    zeros = torch.cat([target.transpose(1, 2), torch.zeros(4, 5, 3)], dim=1)
    expected = torch.linalg.lstsq(rows_added, zeros).solution.transpose(1, 2)
    torch.testing.assert_close(solve_ridge(basis, target, 4.0), expected, atol=1e-4, rtol=1e-3)


def test_principal_functions_follow_the_curves_better_than_plain_cosines(fitted: StrandGenerator) -> None:
    layer = fitted.synthesiser
    # The curves that `fitted` was made from.
    curves = synthetic_curves(500, torch.Generator().manual_seed(0))
    steps = (segments(curves) / lengths(curves)[:, None, None] * 99).transpose(1, 2).flatten(0, 1)
    waves = layer.carriers(times(100, "gradient", layer.carrier_frequency), 100)
    rest = []
    for basis in (layer.smooth_mix @ waves, waves[: layer.config.smooth]):
        measured = metric(layer, 100)
        solution = torch.linalg.lstsq((basis @ measured).T, (steps @ measured).T).solution
        rest.append(((steps - solution.T @ basis) @ measured).square().sum())
    assert rest[0] < rest[1]
