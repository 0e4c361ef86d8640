"""The expected cost of a fit, from a few timed steps on stand-in data."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.evaluation.timing import peak_memory
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.losses import Perceptual
from neural_strands.fitting.schedule import appearance_begins, improves
from neural_strands.flow.hair_flow import flow_memory
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.prior.vae import StrandPrior
from neural_strands.runs.stereo_trial import stereo_seconds
from neural_strands.runs.tracing_trial import tracing_seconds
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import sample_roots

STAND_IN_POINTS = 20_000
STAND_IN_HEIGHT = 0.01
"""Height of the stand-in segments above the scalp, metres."""
USUAL_REACH = 0.25
"""Distance from the middle of the scalp to which hair of unknown extent is expected, metres: below the shoulders."""


@dataclass(frozen=True)
class Forecast:
    """Expected cost of a fit.

    Attributes:
        stereo_seconds: line-based multi-view stereo; 0 when segments are given, None if a trial was not possible.
        tracing_seconds: tracing the initial strands of straight hair; curls and waves take more.
        shape_seconds: one step that updates strands by the geometric loss.
        image_seconds: one step with an image.
        colour_seconds: finding colours in closed form.
        fit_seconds: all steps, and these colours.
        memory_bytes: peak of the trial steps plus that of tracing the initial strands.
    """

    stereo_seconds: float | None
    tracing_seconds: float
    shape_seconds: float
    image_seconds: float
    colour_seconds: float
    fit_seconds: float
    memory_bytes: int

    def sentence(self) -> str:
        """The forecast as a sentence for the user."""
        tracing, steps = self.tracing_seconds / 60, self.fit_seconds / 60
        parts = f"{tracing:.1f} for first strands (more if they curl), {steps:.1f} for the steps"
        if self.stereo_seconds is None:
            minutes = f"stereo, whose time is unknown, and about {tracing + steps:.1f} minutes: {parts}"
        else:
            stereo = self.stereo_seconds / 60
            minutes = f"about {stereo + tracing + steps:.1f} minutes: {stereo:.1f} for stereo, {parts}"
        return (
            f"expect {minutes} ({self.shape_seconds:.2f} s without and {self.image_seconds:.2f} s with an image); "
            f"memory about {self.memory_bytes / 1e9:.1f} GB"
        )


def forecast(
    capture: Capture,
    head: Head,
    prior: StrandPrior,
    config: FitConfig,
    perceptual: Perceptual | None,
    device: torch.device,
    segments: LineSegments | None,
    distance: SignedDistanceGrid,
) -> Forecast:
    """Time a few steps on points above the scalp that stand in for the segments, and trials of stereo and tracing.

    Args:
        capture: all views.
        head: mesh and scalp.
        prior: strand prior.
        config: configuration of the planned fit.
        perceptual: perceptual distance of the fit, if any.
        device: device of the fit.
        segments: those of the fit; None if stereo has to compute them first. Without them, the extent of the hair is
            unknown, and memory is estimated for hair as large as the bust.
        distance: signed distance to the head.
    """
    roots = sample_roots(head.to("cpu"), STAND_IN_POINTS, torch.Generator().manual_seed(config.seed))
    points = roots.position + STAND_IN_HEIGHT * roots.normal
    count = torch.arange(len(points))
    stand_in = LineSegments(points, roots.frame[..., 0].contiguous(), torch.ones(len(points)), count)
    # Of a GPU's first few steps of each kind, most of the time is spent on loading kernels.
    each = 8 if device.type == "cuda" else 3
    schedule = replace(config.schedule, geometry_only=0.5, improved_from=1.0)
    trial = replace(config, steps=2 * each, initialise="mean", schedule=schedule)
    # A step compares strands with the streaks of few views; the time does not depend on which.
    data = gather_fit_data(capture, head, stand_in, trial, device, distance, config.streaks.views)
    seconds: list[float] = []
    state = begin(data, prior, trial)
    fit(state, data, trial, perceptual, after_step=lambda _, row: seconds.append(row["seconds"]))
    shape, image = min(seconds[1:each]), sum(sorted(seconds[each:])[:2]) / 2
    # Part of the first step with an image.
    colours = max(0.0, seconds[each] - image)
    if len(state.model.textures.view) and improves(config.steps, config.schedule):
        colours *= 2  # Improving them takes about as long.
    plain = appearance_begins(config.steps, config.schedule)
    # Measured before the trials of tracing and stereo raise the peak.
    memory, tracing = peak_memory(device), 0.0
    if config.initialise == "flow":
        extent = near_roots(head, roots.position) if segments is None else segments.points.cpu()
        memory += flow_memory(torch.cat([extent, roots.position]), config.initial.flow)
        tracing = tracing_seconds(data, roots.to(device), segments, extent, config)
    return Forecast(
        stereo_seconds=stereo_seconds(capture, head, config, device) if segments is None else 0.0,
        tracing_seconds=tracing,
        shape_seconds=shape,
        image_seconds=image,
        colour_seconds=colours,
        fit_seconds=plain * shape + colours + (config.steps - plain) * image,
        memory_bytes=memory,
    )


def near_roots(head: Head, roots: Float[Tensor, "root 3"]) -> Float[Tensor, "vertex 3"]:
    """Vertices of the head mesh that are as near to the roots as hair usually is: the mesh may be a whole body."""
    vertices = head.mesh.vertices.cpu()
    return vertices[(vertices - roots.mean(dim=0)).norm(dim=1) < USUAL_REACH]


def steps_for(minutes: float, cost: Forecast, config: FitConfig) -> int:
    """Number of steps that fit into `minutes`; at least ten, so that there is a result."""
    share = appearance_begins(config.steps, config.schedule) / config.steps
    mean = share * cost.shape_seconds + (1 - share) * cost.image_seconds
    return max(10, int((60 * minutes - cost.colour_seconds) / mean))
