"""From a capture, a head and line segments to a fit that is ready to run."""

from dataclasses import replace

import torch

from neural_strands.capture.capture import Capture
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.model.hair_model import HairModel
from neural_strands.prior.vae import StrandPrior
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import sample_roots
from neural_strands.training.fit import FitState, start_fit
from neural_strands.training.fit_config import FitConfig
from neural_strands.training.fit_data import FitData, check_inputs
from neural_strands.training.initial import flow_latents, hair_flow, texture_from_latents
from neural_strands.training.losses import OrientedTargets
from neural_strands.training.masked_views import MaskedViews


def training_views(capture: Capture, config: FitConfig) -> list[int]:
    """Views that the fit may see: all but every `hold_out_every`-th."""
    return [index for index in range(len(capture)) if not _held_out(index, config)]


def held_out_views(capture: Capture, config: FitConfig) -> list[int]:
    """Views kept for evaluation."""
    return [index for index in range(len(capture)) if _held_out(index, config)]


def prepare(capture: Capture, head: Head, segments: LineSegments, config: FitConfig, device: torch.device) -> FitData:
    """Gather what the steps look at.

    Args:
        capture: all views; those held out are left out here.
        head: mesh and scalp chart.
        segments: line segments of the training views, signed from root to tip.
        config: which views are held out, radii.
        device: where tensors go.

    Raises:
        InputError: too few views or segments, or a head far from the hair.
    """
    seen = capture.subset(training_views(capture, config))
    check_inputs(seen, segments, head)
    segments, head = segments.to(device), head.to(device)
    grid = PointGrid.build(segments.points, config.chamfer.surface_radius / 2)
    return FitData(
        capture=seen,
        head=head,
        segments=segments,
        targets=OrientedTargets(segments.points, segments.directions, grid),
        distance=SignedDistanceGrid.build(head.mesh),
    )


def first_model(data: FitData, prior: StrandPrior, config: FitConfig) -> HairModel:
    """A model with its roots placed and, if asked for, first strands traced through the flow of the segments."""
    device = data.segments.points.device
    random = torch.Generator().manual_seed(config.seed)
    roots = sample_roots(data.head.to("cpu"), config.strands, random)
    model = HairModel(config.model, roots, prior.generator, data.head.to("cpu").mesh, random).to(device)
    if config.initialise == "flow":
        roots, mesh = roots.to(device), data.head.mesh
        flow = hair_flow(data.segments, MaskedViews.of(data.capture, device), mesh, roots, config.initial)
        latents = flow_latents(flow, roots, prior, replace(config.initial.trace, points=config.model.points))
        model.textures.shape.data.copy_(texture_from_latents(roots.uv, latents, config.model.textures.shape_size))
    return model


def begin(data: FitData, prior: StrandPrior, config: FitConfig) -> FitState:
    """A fit at step 0."""
    return start_fit(first_model(data, prior, config), config)


def _held_out(index: int, config: FitConfig) -> bool:
    return config.hold_out_every > 0 and index % config.hold_out_every == config.hold_out_every - 1
