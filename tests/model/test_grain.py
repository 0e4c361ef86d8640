"""Grain: the noise that is drawn has the strength and the softness that were learned."""

import math
from dataclasses import replace

import pytest
import torch
from test_model_hair_model import model, view
from torch.nn.functional import softplus

from neural_strands.foundation.srgb import to_srgb
from neural_strands.model.grain import KNOTS, SCALE, SOFT, Grain
from neural_strands.model.renderer import HairRenderer

NONE = -30.0
"""What is learned where there is no grain."""
SIDE = 400


def only(softness: int, colour: int, level: float = 0.0) -> Grain:
    """Grain of one kind."""
    grain = Grain()
    with torch.no_grad():
        grain.level.fill_(NONE)
        grain.level[softness, colour] = level
    return grain


def drawn(grain: Grain, brightness: float, seed: int = 0) -> torch.Tensor:
    with torch.no_grad():
        return grain(torch.full((SIDE, SIDE, 3), brightness), torch.Generator().manual_seed(seed))


def correlation(one: torch.Tensor, other: torch.Tensor) -> float:
    return float(torch.corrcoef(torch.stack([one.flatten(), other.flatten()]))[0, 1])


@pytest.mark.parametrize("softness", [0, 1])
@pytest.mark.parametrize("colour", [0, 1])
def test_each_kind_has_the_amplitude_that_was_learned(softness, colour):
    expected = SCALE * float(softplus(torch.tensor(0.7)))
    assert float(drawn(only(softness, colour, 0.7), 0.4).std()) == pytest.approx(expected, rel=0.03)


def test_white_noise_is_of_every_pixel_alone_and_soft_noise_is_as_after_a_gaussian():
    white, soft = (drawn(only(softness, 0), 0.4)[..., 0] for softness in (0, 1))
    for lag in (1, 2):
        for axis in (0, 1):
            for noise, expected in ((white, 0.0), (soft, math.exp(-((lag / (2 * SOFT)) ** 2)))):
                shifted = noise.narrow(axis, lag, SIDE - lag), noise.narrow(axis, 0, SIDE - lag)
                assert correlation(*shifted) == pytest.approx(expected, abs=0.02)


def test_grey_noise_is_the_same_in_every_channel_and_coloured_noise_is_not():
    grey, coloured = (drawn(only(0, colour), 0.4) for colour in (0, 1))
    for channel in (1, 2):
        # Of coloured noise, e^-30 is left.
        torch.testing.assert_close(grey[..., 0], grey[..., channel], atol=1e-12, rtol=0)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        assert correlation(coloured[..., one], coloured[..., other]) == pytest.approx(0, abs=0.02)


def test_the_amplitude_is_a_curve_over_brightness_held_beyond_its_ends():
    grain = only(0, 0)
    with torch.no_grad():
        grain.curve[0, 0] = torch.linspace(-2, 2, KNOTS)
    knots = SCALE * softplus(torch.linspace(-2, 2, KNOTS))
    step = 1 / (KNOTS - 1)
    expected = {-0.5: knots[0], 0.0: knots[0], 1.5 * step: (knots[1] + knots[2]) / 2, 1.0: knots[-1], 1.7: knots[-1]}
    for brightness, amplitude in expected.items():
        assert float(drawn(grain, brightness).std()) == pytest.approx(float(amplitude), rel=0.03)


def test_a_generator_draws_the_same_grain_again_and_another_one_does_not():
    grain = Grain()
    assert torch.equal(drawn(grain, 0.3, seed=5), drawn(grain, 0.3, seed=5))
    assert not torch.equal(drawn(grain, 0.3, seed=5), drawn(grain, 0.3, seed=6))


def test_a_single_brightness_teaches_the_strength_at_all_of_them_but_not_the_picture():
    grain = Grain()
    picture = torch.full((20, 20, 3), 0.1, requires_grad=True)
    before = grain.amplitudes().detach()
    grain(picture, torch.Generator().manual_seed(0)).square().mean().backward()
    assert picture.grad is None
    torch.optim.SGD(grain.parameters(), lr=100).step()
    assert bool((grain.amplitudes() < before).all())


def test_the_noise_of_a_picture_is_found_again():
    """By its energy, grey and coloured apart, as a stand-in for what LPIPS sees of it."""
    true, grain = 0.01, Grain()
    noisy = 0.4 + true * torch.randn(100, 100, 3, generator=torch.Generator().manual_seed(3))

    def energy(picture: torch.Tensor) -> torch.Tensor:
        grey = picture.mean(dim=2, keepdim=True)
        parts = (grey[1:] - grey[:-1], grey[2:] - grey[:-2], (picture - grey)[1:] - (picture - grey)[:-1])
        return torch.stack([part.square().mean().sqrt() for part in parts])

    optimiser = torch.optim.Adam(grain.parameters(), lr=6e-2)
    for step in range(150):
        optimiser.zero_grad()
        picture = torch.full_like(noisy, 0.4)
        found = picture + grain(picture, torch.Generator().manual_seed(step))
        (energy(found) - energy(noisy)).square().sum().backward()
        optimiser.step()
    assert float(drawn(grain, 0.4).std()) == pytest.approx(true, rel=0.1)


def test_a_picture_gets_grain_where_it_shows_hair_and_nowhere_else():
    renderer = HairRenderer.of(model(mixed_precision=False))
    output = renderer.render(view())
    torch.testing.assert_close(renderer.with_grain(output, 0.0).rgb, output.rgb)
    bare = output.alpha.new_zeros(output.alpha.shape, dtype=torch.bool)
    bare[:, :5] = True
    output = replace(output, alpha=output.alpha.masked_fill(bare, 0.0))
    clean, grainy = renderer.with_grain(output, 0.0), renderer.with_grain(output, seed=1)
    torch.testing.assert_close(grainy.rgb[bare], clean.rgb[bare])
    assert not torch.allclose(grainy.rgb[~bare], clean.rgb[~bare])
    change = to_srgb(grainy.hair_rgb) - to_srgb(output.hair_rgb)
    with torch.no_grad():
        expected = renderer.model.grain(to_srgb(output.hair_rgb), torch.Generator().manual_seed(1))
    torch.testing.assert_close(change, expected, atol=1e-5, rtol=0)
    halved = to_srgb(renderer.with_grain(output, 0.5, seed=1).hair_rgb) - to_srgb(output.hair_rgb)
    torch.testing.assert_close(halved, 0.5 * expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(grainy.cutout[..., :3], to_srgb(grainy.hair_rgb))
