"""Decoding: in blocks and all at once, at several resolutions, and its bounds."""

from typing import Literal

import pytest
import torch

from neural_strands.prior import blocks as fast
from neural_strands.prior.generator import GeneratorConfig, StrandGenerator
from neural_strands.prior.synthesiser import Modulation, Output, SynthesiserConfig
from neural_strands.prior.vae import load_prior

Modulator = Literal["coupling", "mlp"]


@pytest.fixture(scope="module")
def generator_net() -> StrandGenerator:
    return load_prior().generator


def test_blocks_give_the_same_values_and_gradients(generator_net: StrandGenerator, generator: torch.Generator) -> None:
    latent = torch.randn(fast.BLOCK + 37, 64, generator=generator)
    cotangent = torch.randn(len(latent), 20, 3, generator=generator)
    results = []
    for decode in (generator_net.forward, generator_net.reference):
        leaf = latent.clone().requires_grad_(True)
        strands = decode(leaf, 20)
        strands.backward(cotangent)
        results.append((strands.detach(), leaf.grad))
    torch.testing.assert_close(results[0][0], results[1][0], atol=1e-6, rtol=1e-5)
    torch.testing.assert_close(results[0][1], results[1][1], atol=1e-5, rtol=1e-4)
    with torch.no_grad():
        torch.testing.assert_close(generator_net(latent, 20), results[0][0], atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("points", [12, 25, 34, 397])
def test_all_resolutions_give_the_same_curve(
    generator_net: StrandGenerator, generator: torch.Generator, points: int
) -> None:
    latent = 0.7 * torch.randn(200, 64, generator=generator)
    fine = generator_net(latent, 12 * 396 // 4 + 1)
    other = generator_net(latent, points)
    at = torch.linspace(0, 1, points) * (fine.shape[1] - 1)
    index = at.floor().long().clamp(max=fine.shape[1] - 2)
    matching = torch.lerp(fine[:, index], fine[:, index + 1], (at - index)[:, None])
    size = (fine[:, 1:] - fine[:, :-1]).norm(dim=-1).sum(dim=1)
    gap = (other - matching).norm(dim=-1).mean(dim=1) / size
    # The warp is not integrated exactly, so coarse sums of fast chirps differ a little.
    assert gap.mean() < 2e-3
    assert gap.mean() < 1e-4 or points < 100


def test_the_root_is_at_zero_and_gradients_reach_every_latent(
    generator_net: StrandGenerator, generator: torch.Generator
) -> None:
    latent = torch.randn(30, 64, generator=generator, requires_grad=True)
    strands = generator_net(latent)
    assert (strands[:, 0] == 0).all()
    strands.square().sum().backward()
    assert latent.grad is not None
    assert torch.isfinite(latent.grad).all()
    assert (latent.grad.abs().amax(dim=0) > 0).all()


def test_no_strand_and_far_latents_decode_to_finite_strands(generator_net: StrandGenerator) -> None:
    assert generator_net(torch.zeros(0, 64)).shape == (0, 100, 3)
    assert torch.isfinite(generator_net(torch.full((2, 64), 8.0))).all()


@pytest.mark.parametrize("output", ["gradient", "position"])
@pytest.mark.parametrize("modulation", ["all", "amplitude"])
@pytest.mark.parametrize("modulator", ["coupling", "mlp"])
def test_untrained_generators_give_finite_strands(
    output: Output, modulation: Modulation, modulator: Modulator, generator: torch.Generator
) -> None:
    inner = SynthesiserConfig(output=output, modulation=modulation)
    strands = StrandGenerator(GeneratorConfig(modulator=modulator, synthesiser=inner))(
        torch.randn(5, 64, generator=generator)
    )
    assert torch.isfinite(strands).all()
    assert (strands[:, 0] == 0).all()
    assert (strands[:, -1].norm(dim=-1) > 1e-3).all()


def test_wrong_shapes_are_named(generator_net: StrandGenerator) -> None:
    with pytest.raises(ValueError, match=r"latent must be \(strand, 64\), found \(3, 63\)"):
        generator_net(torch.zeros(3, 63))
    with pytest.raises(ValueError, match="at least two points, found 1"):
        generator_net(torch.zeros(3, 64), 1)


def test_latent_inverts_raw(generator_net: StrandGenerator, generator: torch.Generator) -> None:
    latent = torch.randn(20, 64, generator=generator)
    back, _ = generator_net.latent(generator_net.raw(latent).flat())
    torch.testing.assert_close(back, latent, atol=2e-3, rtol=0)


@pytest.mark.gpu
def test_cuda_decodes_as_the_cpu_does(generator: torch.Generator, cuda: torch.device) -> None:
    latent = torch.randn(100, 64, generator=generator)
    there = load_prior(device=cuda).decode(latent.to(cuda)).cpu()
    torch.testing.assert_close(there, load_prior().decode(latent), atol=1e-4, rtol=1e-3)
