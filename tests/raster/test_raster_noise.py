"""Noise is white and normal, and the same on every device and number of threads."""

import torch
from scipy import stats

from neural_strands.raster.noise import normal_noise


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_noise_is_normal_and_white(device):
    noise = normal_noise((4, 200, 200), seeded(0), device).cpu()
    assert stats.kstest(noise.view(-1).numpy(), "norm").pvalue > 0.01
    spectrum = torch.fft.rfft2(noise).abs().square()[:, 1:, 1:] / 200**2
    # The power of white noise is 1 at every frequency, and has an exponential distribution.
    assert stats.kstest(spectrum.reshape(-1).numpy(), "expon").pvalue > 0.01
    flat = noise.view(4, -1)
    assert (torch.corrcoef(flat) - torch.eye(4)).abs().max() < 0.02


def test_seeds_draw_other_noise_and_devices_the_same(device):
    first, second = (normal_noise((50, 60), seeded(seed), device).cpu() for seed in (0, 1))
    assert torch.corrcoef(torch.stack([first.view(-1), second.view(-1)]))[0, 1].abs() < 0.06
    here = normal_noise((50, 60), seeded(0), torch.device("cpu"))
    torch.testing.assert_close(first, here, atol=1e-4, rtol=1e-4)


def test_a_generator_goes_on():
    random = seeded(0)
    first, second = (normal_noise((100,), random, torch.device("cpu")) for _ in range(2))
    assert not torch.equal(first, second)
