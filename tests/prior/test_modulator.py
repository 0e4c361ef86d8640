"""The modulators: invertible, with the volume change that autograd finds."""

import pytest
import torch

from neural_strands.prior.modulator import CouplingModulator, MlpModulator


def trained(latent: int = 6, layers: int = 3) -> CouplingModulator:
    """A modulator away from its identity start."""
    modulator = CouplingModulator(latent, 8, layers).double()
    generator = torch.Generator().manual_seed(1)
    for value in modulator.parameters():
        value.data = 0.7 * torch.randn(value.shape, generator=generator, dtype=torch.float64)
    return modulator.requires_grad_(False)


def test_inverse_undoes_forward(generator: torch.Generator) -> None:
    latent = torch.randn(50, 6, generator=generator, dtype=torch.float64)
    modulator = trained()
    value = modulator(latent)
    assert (value - latent).abs().max() > 0.1
    torch.testing.assert_close(modulator.inverse(value)[0], latent)


def test_log_volume_is_the_jacobian_of_the_inverse(generator: torch.Generator) -> None:
    modulator = trained()
    value = modulator(torch.randn(4, 6, generator=generator, dtype=torch.float64))
    volume = modulator.inverse(value)[1]
    for row, expected in zip(value, volume, strict=True):
        jacobian = torch.autograd.functional.jacobian(lambda v: modulator.inverse(v[None])[0][0], row)
        torch.testing.assert_close(torch.linalg.slogdet(jacobian)[1], expected)


@pytest.mark.parametrize("layers", [0, 1, 5])
def test_before_training_it_is_the_identity(layers: int, generator: torch.Generator) -> None:
    latent = torch.randn(5, 8, generator=generator)
    assert torch.equal(CouplingModulator(8, 4, layers)(latent), latent)
    assert torch.equal(MlpModulator(8, 4, max(layers, 1))(latent), latent)


def test_an_odd_latent_is_refused() -> None:
    with pytest.raises(ValueError, match="even latent, found 7"):
        CouplingModulator(7, 4, 1)
