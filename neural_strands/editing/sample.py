"""New hairstyles from the strand prior: a smooth random field of latents over the scalp."""

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.mix import azimuth, turned
from neural_strands.editing.settings import Sample
from neural_strands.foundation.errors import InputError
from neural_strands.model.hair_model import HairModel
from neural_strands.prior.generator import StrandGenerator
from neural_strands.prior.modulator import CouplingModulator
from neural_strands.prior.vae import load_prior

COARSE = 12
"""Number of random latents along each side of the chart; in between they are interpolated smoothly."""


@torch.no_grad()
def sample_style(sample: Sample, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """Mix the present hairstyle with one sample of the prior for the whole scalp and smooth variation around it.

    The prior models single strands; the structure of the hairstyle, such as its parting, comes from the run. So every
    sampled strand is first rotated about the scalp's normal until it heads the way of the run's strand there. Otherwise
    one sample would head the same way in the frame of every root, and hair would stick out sideways.

    In the prior's own space, fitted and sampled strands both have unit deviation, and the mixture is scaled to have it
    too.

    Latents of a fit are the output of the prior's modulator (`StrandPrior.without_modulator`), in which samples of
    N(0, I) look less like hair; so latents are drawn before the modulator, and pass through it.

    Raises:
        InputError: the model was fitted with another prior than that of the package.
    """
    prior = load_prior(device=shape.texture.device)
    if not torch.equal(prior.generator.linear.weight, model.generator.linear.weight):
        raise InputError(
            "sample: expected a model with the strand prior that ships with the package, found another; fit with that."
        )
    random = torch.Generator().manual_seed(sample.seed)
    rows, columns, size = shape.texture.shape
    # The two parts add up to the prior's unit deviation.
    common = torch.randn(size, 1, 1, generator=random) / (1 + sample.variety**2) ** 0.5
    field = torch.randn(1, size, COARSE, COARSE, generator=random) * sample.variety / (1 + sample.variety**2) ** 0.5
    smooth = functional.interpolate(field, size=(rows, columns), mode="bicubic", align_corners=True)[0]
    drawn = (common + smooth).permute(1, 2, 0).reshape(-1, size).to(shape.texture)
    modulator = prior.generator.modulator
    # The package's prior has this modulator.
    assert isinstance(modulator, CouplingModulator)
    without = not len(model.generator.modulator.state_dict())
    fitted = shape.texture.reshape(-1, size)
    drawn = _headed_like(fitted, modulator(drawn) if without else drawn, model.generator)
    if without:
        (fitted, _), (drawn, _) = modulator.inverse(fitted), modulator.inverse(drawn)
    latent = sample.likeness * fitted + (1 - sample.likeness**2) ** 0.5 * drawn
    if without:
        latent = modulator(latent)
    return replace(shape, texture=latent.reshape(shape.texture.shape))


def _headed_like(
    fitted: Float[Tensor, "strand latent"], drawn: Float[Tensor, "strand latent"], generator: StrandGenerator
) -> Float[Tensor, "strand latent"]:
    """Rotate drawn strands about the scalp's normal until they head the way of the fitted ones."""
    ours, theirs = generator.raw(fitted), generator.raw(drawn)
    latent, _ = generator.latent(turned(theirs, azimuth(ours) - azimuth(theirs)).flat())
    return latent
