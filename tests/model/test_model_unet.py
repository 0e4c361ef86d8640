"""The image generator: shapes, gradients, and equivariance to sub-pixel shifts."""

import math

import pytest
import torch

from neural_strands.model.unet import UNet, UNetConfig

CHANNELS = 7
SMALL = UNetConfig(widths=(8, 12, 16))


def network(alias_free: bool = True, seed: int = 0) -> UNet:
    config = UNetConfig(widths=SMALL.widths, alias_free=alias_free)
    return UNet(CHANNELS, config, torch.Generator().manual_seed(seed))


def pyramid(height: int, width: int, generator: torch.Generator) -> list[torch.Tensor]:
    shapes = [(1, CHANNELS, -(-height // 2**level), -(-width // 2**level)) for level in range(SMALL.levels)]
    return [torch.randn(shape, generator=generator, requires_grad=True) for shape in shapes]


@pytest.mark.parametrize("alias_free", [True, False])
@pytest.mark.parametrize("size", [(16, 24), (17, 31), (1, 5), (33, 2)])
def test_any_size_gives_one_output_a_pixel_and_gradients_everywhere(alias_free, size, generator):
    height, width = size
    maps, net = pyramid(height, width, generator), network(alias_free)
    image = net(maps)
    assert image.shape == (1, 4, height, width)
    image.square().sum().backward()
    for tensor in (*maps, *net.parameters()):
        assert tensor.grad is not None
        assert tensor.grad.isfinite().all()
        assert tensor.grad.abs().sum() > 0


@pytest.mark.parametrize("alias_free", [True, False])
def test_padding_does_not_change_the_image(alias_free, generator):
    maps, net = pyramid(16, 16, generator), network(alias_free)
    padded = [torch.nn.functional.pad(m, (0, 8 >> level, 0, 8 >> level)) for level, m in enumerate(maps)]
    top_left = (..., slice(0, 4), slice(0, 4))
    assert net(padded).shape == (1, 4, 24, 24)
    # far from the seam only what is beyond it differs, and that is zero in both
    difference = (net(padded)[top_left] - net(maps)[top_left]).abs().max()
    assert difference < 0.05 * net(maps).abs().max()


def test_every_level_reaches_the_output(generator):
    net = network()
    maps = [m.detach() for m in pyramid(32, 32, generator)]
    before = net(maps)
    for level in range(SMALL.levels):
        changed = [m + 1 if level == k else m for k, m in enumerate(maps)]
        assert (net(changed) - before).abs().max() > 1e-4


def test_wrong_pyramids_are_refused(generator):
    maps = pyramid(16, 16, generator)
    with pytest.raises(ValueError, match="reads 3 descriptor maps, found 2"):
        network()(maps[:2])
    with pytest.raises(ValueError, match="map 1 has sides"):
        network()([maps[0], maps[0], maps[2]])


def shifted_pyramid(shift: float, size: int = 96) -> list[torch.Tensor]:
    """Band-limited periodic features sampled at each level's pixel centres, moved right by `shift` fine pixels."""
    generator = torch.Generator().manual_seed(5)
    terms = [
        (
            torch.randint(-size // 12, size // 12 + 1, (2,), generator=generator).tolist(),
            torch.randn(2, CHANNELS, generator=generator, dtype=torch.float64),
        )
        for _ in range(16)
    ]
    maps = []
    for level in range(SMALL.levels):
        centre = (torch.arange(size >> level, dtype=torch.float64) + 0.5) * 2**level
        x, y = centre - shift, centre[:, None]
        image = torch.zeros(CHANNELS, size >> level, size >> level, dtype=torch.float64)
        for (u, v), (amplitude, phase) in terms:
            angle = 2 * math.pi * (u * x + v * y) / size
            image += amplitude[:, None, None] * torch.cos(angle + 6.0 * phase[:, None, None])
        maps.append(image[None])
    return maps


def equivariance(net: UNet, shift: float, size: int = 96, border: int = 32) -> float:
    """Decibels of peak over the error between shifting the features and shifting the image (EQ-T of StyleGAN3)."""
    whole = (0, slice(0, 3), slice(border, size + border), slice(border, size + border))
    with torch.no_grad():
        still, moved = (
            net(
                [
                    torch.nn.functional.pad(m.float(), [border >> level] * 4, mode="circular")
                    for level, m in enumerate(shifted_pyramid(s, size))
                ]
            )[whole].double()
            for s in (0.0, shift)
        )
    ramp = torch.exp(-2j * math.pi * shift * torch.fft.fftfreq(size, dtype=torch.float64))
    expected = torch.fft.ifft(torch.fft.fft(still) * ramp).real
    peak = expected.max() - expected.min()
    return (10 * torch.log10(peak**2 / (expected - moved).square().mean())).item()


@pytest.mark.parametrize("shift", [0.5, 1.0, 1.5])
def test_moving_the_features_moves_the_image(shift):
    scores = {kind: equivariance(network(kind), shift) for kind in (True, False)}
    assert scores[True] > 45, scores
    assert scores[True] > scores[False] + 15, scores


@pytest.mark.parametrize("alias_free", [True, False])
def test_maps_in_bfloat16_round_only_what_enters_and_leaves_encoders_and_decoders(alias_free, generator, monkeypatch):
    maps, net = [m.detach() for m in pyramid(24, 20, generator)], network(alias_free)
    with torch.no_grad():
        exact, found = net(maps), net([m.bfloat16() for m in maps])
    convolve = torch.nn.functional.conv2d

    def rounded(images: torch.Tensor, weight: torch.Tensor, **options) -> torch.Tensor:
        """A convolution of encoder or decoder in float32, of rounded numbers; resampling stays as it is."""
        if weight.shape[-2:] != (3, 3) or options["stride"] == 2:
            return convolve(images, weight, **options)
        return convolve(images.bfloat16().float(), weight.bfloat16().float(), **options).bfloat16().float()

    monkeypatch.setattr(torch.nn.functional, "conv2d", rounded)
    with torch.no_grad():
        expected = net(maps)
    size = exact.square().mean().sqrt()
    assert found.dtype == torch.float32
    assert 1e-3 * size < (expected - exact).abs().max() < 0.03 * size
    # What differs are roundings of sums that were added up in another order.
    assert (found - expected).square().mean() < 0.1 * (expected - exact).square().mean()
