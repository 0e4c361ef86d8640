"""Initialises training: smooth functions from the curves, and latents with zero mean and unit covariance over them."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.prior.analysis import analyse, principal_functions
from neural_strands.prior.generator import StrandGenerator


@torch.no_grad()
def start_from_curves(generator: StrandGenerator, curves: Float[Tensor, "strand point 3"], refine: int = 1) -> None:
    """Set the smooth functions to the principal ones of the curves, and whiten the latents over them.

    Raises:
        ValueError: the latent and the raw quantities differ in size.
    """
    if generator.config.latent != generator.linear.out_features:
        raise ValueError(
            f"a closed-form start needs as many latents as raw quantities ({generator.linear.out_features}), "
            f"found {generator.config.latent}"
        )
    generator.synthesiser.smooth_mix.copy_(principal_functions(generator.synthesiser, curves))
    white_from_curves(generator, curves, refine)


@torch.no_grad()
def white_from_curves(generator: StrandGenerator, curves: Float[Tensor, "strand point 3"], refine: int = 1) -> None:
    """Set the linear map so that the curves' latents have zero mean and unit covariance (before the modulator).

    The map is the Cholesky factor of the raw quantities' covariance: the first latent is the length, the second the
    gain given the length, then follow frequency, chirp, curl and bends.
    """
    mean, factor = whitening(analyse(generator, curves, refine).flat())
    generator.linear.weight.copy_(factor)
    generator.linear.bias.copy_(mean)


def whitening(samples: Float[Tensor, "sample channel"]) -> tuple[Float[Tensor, " channel"], Float[Tensor, "c c"]]:
    """Mean, and lower Cholesky factor of the covariance with a millionth of its diagonal added."""
    precise = samples.double()
    mean = precise.mean(dim=0)
    covariance = (precise - mean).T @ (precise - mean) / len(precise)
    covariance = covariance + 1e-6 * torch.diag(covariance.diagonal() + 1e-9)
    return mean.to(samples), torch.linalg.cholesky(covariance).to(samples)
