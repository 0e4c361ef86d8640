import pytest
import torch

from neural_strands.raster.reference import splat_reference
from neural_strands.raster.splat import splat, splat_pyramid


def naive(pixels, features, size, minimum_weight):
    height, width = size
    sums, weights = torch.zeros(features.shape[1], height, width), torch.zeros(height, width)
    for (x, y), feature in zip(pixels.tolist(), features, strict=True):
        for v in range(height):
            for u in range(width):
                weight = max(0.0, 1 - abs(x - u - 0.5)) * max(0.0, 1 - abs(y - v - 0.5))
                weights[v, u] += weight
                sums[:, v, u] += weight * feature
    return sums / weights.clamp(min=minimum_weight), weights


@pytest.mark.parametrize("minimum_weight", [1e-3, 0.1, 1.0])
def test_agrees_with_a_naive_loop(generator, device, minimum_weight):
    pixels = torch.rand(60, 2, generator=generator) * torch.tensor([14.0, 11.0]) - 2
    features = torch.randn(60, 5, generator=generator)
    mean, coverage = splat(pixels.to(device), features.to(device), (7, 9), minimum_weight)
    expected_mean, expected_coverage = naive(pixels, features, (7, 9), minimum_weight)
    torch.testing.assert_close(coverage.cpu(), expected_coverage)
    torch.testing.assert_close(mean.cpu(), expected_mean, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("channels", [6, 23])
@pytest.mark.parametrize(("counted", "moving"), [(False, True), (True, True), (True, False)])
def test_kernels_and_twin_agree_in_values_and_gradients(generator, device, channels, counted, moving):
    """Also for as many channels as a hair model has, for which the CPU has a kernel of its own."""
    pixels = (torch.rand(400, 2, generator=generator) * 40 - 4).to(device).requires_grad_(moving)
    features = torch.randn(400, channels, generator=generator).to(device).requires_grad_()
    size, levels, minimum_weight = (31, 33), 4, 0.3
    amounts = torch.randint(0, 5, (400,), generator=generator).float().to(device) if counted else None
    maps = splat_pyramid(pixels, features, size, levels, minimum_weight, amounts)
    outputs, twins = [], []
    for level, found in enumerate(maps):
        level_size = (-(-size[0] // 2**level), -(-size[1] // 2**level))
        assert found.coverage.shape == level_size
        mean, weight = splat_reference(pixels, features, level_size, 0.5**level, minimum_weight, amounts)
        outputs += [found.features, found.coverage]
        twins += [mean.T.view(-1, *level_size), weight.view(level_size)]
    cotangents = [torch.randn(twin.shape, generator=generator).to(device) for twin in twins]
    for output, twin in zip(outputs, twins, strict=True):
        torch.testing.assert_close(output, twin, rtol=1e-4, atol=1e-5)
    learned = [pixels, features] if moving else [features]
    # The coverage depends on the positions alone.
    known = [k for k, twin in enumerate(twins) if twin.requires_grad]
    assert len(known) == (2 * levels if moving else levels)
    gradients, expected = (
        torch.autograd.grad([found[k] for k in known], learned, [cotangents[k] for k in known])
        for found in (outputs, twins)
    )
    for gradient, twin in zip(gradients, expected, strict=True):
        torch.testing.assert_close(gradient, twin, rtol=1e-3, atol=1e-4)


def test_a_point_that_counts_thrice_is_three_points(generator, device):
    pixels = (torch.rand(50, 2, generator=generator) * 9).to(device)
    features = torch.randn(50, 3, generator=generator).to(device)
    amounts = torch.randint(0, 4, (50,), generator=generator).to(device)
    once = splat(pixels, features, (9, 9), amounts=amounts.float())
    repeated = splat(pixels.repeat_interleave(amounts, 0), features.repeat_interleave(amounts, 0), (9, 9))
    torch.testing.assert_close(once.features, repeated.features, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(once.coverage, repeated.coverage, rtol=1e-4, atol=1e-5)


def test_gradients_are_those_of_finite_differences(generator):
    pixels = torch.rand(12, 2, generator=generator, dtype=torch.float64) * 6
    features = torch.randn(12, 3, generator=generator, dtype=torch.float64)

    def run(where, what):
        return tuple(plane for found in splat_pyramid(where, what, (6, 5), 2) for plane in found)

    assert torch.autograd.gradcheck(run, (pixels.requires_grad_(), features.requires_grad_()), eps=1e-7, atol=1e-4)


def test_only_one_output_needs_a_gradient(generator):
    pixels = (torch.rand(20, 2, generator=generator) * 8).requires_grad_()
    features = torch.randn(20, 2, generator=generator).requires_grad_()
    maps = splat_pyramid(pixels, features, (8, 8), 3)
    maps[1].coverage.square().sum().backward()
    expected = pixels.detach().clone().requires_grad_()
    splat_reference(expected, features.detach(), (4, 4), 0.5, 0.1)[1].square().sum().backward()
    torch.testing.assert_close(pixels.grad, expected.grad)
    assert features.grad is None or not features.grad.any()


def test_total_weight_is_the_number_of_points_inside(generator):
    pixels = torch.rand(500, 2, generator=generator) * 28 + 2
    coverage = splat(pixels, torch.zeros(500, 1), (32, 32)).coverage
    assert coverage.sum().item() == pytest.approx(500, rel=1e-5)


def test_no_points_give_an_empty_image():
    mean, coverage = splat(torch.zeros(0, 2), torch.zeros(0, 4), (5, 7))
    assert mean.shape == (4, 5, 7)
    assert not mean.any()
    assert not coverage.any()


def test_points_that_are_not_finite_or_far_away_are_left_out():
    pixels = torch.tensor([[float("nan"), 1.0], [float("inf"), 2.0], [-1e30, 3.0], [1e12, 1e12], [2.5, 2.5]])
    pixels.requires_grad_()
    mean, coverage = splat(pixels, torch.ones(5, 1), (5, 5))
    assert coverage.sum().item() == pytest.approx(1.0)
    (mean.sum() + coverage.sum()).backward()
    assert pixels.grad is not None
    assert pixels.grad.isfinite().all()
