"""The model that a fit starts from: roots on the scalp and an initial strand at each of them."""

from dataclasses import replace
from pathlib import Path

import torch

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.first_strands import hair_roots, texture_from_latents, trace_first_strands
from neural_strands.fitting.fit import FitState, start_fit
from neural_strands.fitting.fit_data import FitData
from neural_strands.fitting.view_colours import CLOSE
from neural_strands.foundation.progress import Feedback
from neural_strands.geometry.frames import to_local
from neural_strands.model.hair_model import HairModel
from neural_strands.model.networks import Networks, shipped_networks, start_networks
from neural_strands.model.seen_directions import seen_from, usual_gap
from neural_strands.prior.vae import StrandPrior, load_prior


def fit_prior(path: Path | None, device: torch.device) -> StrandPrior:
    """Load the prior for a fit, without its coupling layers: the given weights, or the package's own by default.

    Raises:
        InputError: the file does not exist or is not a strand prior.
    """
    prior = load_prior(path, device)
    return prior.without_modulator() if prior.generator.config.modulator == "coupling" else prior


def first_model(
    data: FitData,
    prior: StrandPrior,
    config: FitConfig,
    feedback: Feedback | None = None,
    networks: Networks | None = None,
) -> HairModel:
    """Build the model with its roots and, if configured, initial strands traced through the flow of the segments.

    Args:
        data: inputs of the fit.
        prior: encodes the initial strands.
        config: settings of the fit.
        feedback: receives the progress of tracing, and what was found out about the hair.
        networks: weights from which the networks start, instead of those that `config.networks` says.
    """
    device = data.segments.points.device
    random = torch.Generator().manual_seed(config.seed)
    roots = hair_roots(data.head, config.strands, data.views, config.initial.hull, random)
    first = None
    if config.initialise == "flow":
        initial = replace(config.initial, trace=replace(config.initial.trace, points=config.model.points))
        first = trace_first_strands(
            data.head, data.segments, data.views, roots.to(device), initial, data.distance, random, feedback
        )
        roots = first.roots.to("cpu")
    model = HairModel(config.model, roots, prior.generator, data.head.to("cpu").mesh, random).to(device)
    if networks is None and config.networks == "learned":
        networks = shipped_networks(config.model)
    if networks is not None:
        start_networks(model, networks)
    places = torch.stack([camera.position.cpu() for camera in data.views.cameras])
    seen = seen_from(places, model.background.centre.cpu())
    model.photographed_from(seen)
    if usual_gap(seen) <= CLOSE:
        model.textures.change_with_view()
    if first is not None:
        latents = prior.encode(to_local(first.strands.points, first.roots.position, first.roots.frame))
        texture = texture_from_latents(first.roots.uv, latents, config.model.textures.shape_size)
        model.textures.shape.data.copy_(texture)
    return model


def begin(
    data: FitData,
    prior: StrandPrior,
    config: FitConfig,
    feedback: Feedback | None = None,
    networks: Networks | None = None,
) -> FitState:
    """Start a fit at step 0; see `first_model`."""
    return start_fit(first_model(data, prior, config, feedback, networks), config)
