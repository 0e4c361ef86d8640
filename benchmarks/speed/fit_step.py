"""Cost of one step of the fit, part by part: `python benchmarks/speed/fit_step.py [--preset fast] [--device cpu]`.

Stand-in segments above the built-in mannequin and grey photographs: no data is needed, the work is that of a real step.
Prints each part, those that have a naive twin or a peer beside it, and how whole steps grow with strands, pixels of the
region, and photographs.
"""

import itertools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
import torch
import tyro
from beside import Beside, beside, beside_table, table
from fit_step_twins import StepTwins

from neural_strands.capture.capture import Capture
from neural_strands.capture.writer import CaptureWriter
from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.evaluation.timing import peak_memory, time_function
from neural_strands.fitting.config import FitConfig, Preset, preset
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit, step_generator
from neural_strands.fitting.fit_data import FitData, gather_fit_data, random_region
from neural_strands.fitting.losses import coverage_loss, head_penalty, surface_loss
from neural_strands.fitting.seen_points import seen_points
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.strands import Strands, directions
from neural_strands.prior.vae import load_prior
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import sample_roots
from neural_strands.synthesis.dome import DomeConfig, dome

SEGMENT_POINTS = 100_000
VIEWS = 8


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    preset: Preset = "fast"
    """Settings of the fit."""
    device: DeviceName = "cpu"
    """Device."""
    resolution: int = 512
    """Side of the photographs, pixels."""
    twins: bool = True
    """Run twins and peers."""
    grow: bool = True
    """Measure how whole steps grow."""


def grey_capture(folder: Path, points: torch.Tensor, resolution: int, views: int = VIEWS) -> None:
    """A capture of grey photographs of that size."""
    writer, cameras = CaptureWriter(folder), dome(points, DomeConfig(views, resolution))
    for camera in cameras:
        writer.write_view(camera, np.full((resolution, resolution, 3), 128, np.uint8))
    writer.finish(cameras)


@contextmanager
def stand_in(
    name: Preset, device: torch.device, resolution: int, views: int = VIEWS
) -> Iterator[tuple[FitData, FitConfig]]:
    """Inputs and settings of a fit; the photographs exist within the block."""
    config = replace(preset(name), initialise="mean", hold_out_every=0)
    head = mannequin()
    roots = sample_roots(head, SEGMENT_POINTS, torch.Generator().manual_seed(0))
    lifted = roots.position + 0.01 * roots.normal
    number = torch.arange(len(lifted))
    segments = LineSegments(lifted, roots.frame[..., 0].contiguous(), torch.ones(len(lifted)), number)
    with TemporaryDirectory() as folder:
        grey_capture(Path(folder), lifted, resolution, views)
        yield gather_fit_data(Capture.load(folder), head, segments, config, device), config


def step_seconds(
    data: FitData,
    config: FitConfig,
    geometry_only: float,
    runs: int = 10,
    clock: Callable[[], float] = time.perf_counter,
) -> list[float]:
    """Time of whole steps.

    Args:
        data: inputs of the fit.
        config: settings.
        geometry_only: 1 for shape steps, 0 for image steps.
        runs: number of steps; two more come before them.
        clock: of wall time, or of processor time.
    """
    schedule = replace(config.schedule, geometry_only=geometry_only)
    trial = replace(config, steps=runs + 2, shape_every=10_000, schedule=schedule)
    fresh = begin(data, load_prior(device=data.segments.points.device), trial)
    ends: list[float] = []
    fit(fresh, data, trial, structural_loss, after_step=lambda *_: ends.append(clock()))
    return [end - begin for begin, end in itertools.pairwise(ends[1:])]


def parts(data: FitData, config: FitConfig) -> tuple[dict[str, Callable[[], object]], StepTwins]:
    """The parts of a shape step and of an image step, and their twins."""
    device = data.segments.points.device
    state = begin(data, load_prior(device=device), config)
    model = state.model
    random = step_generator(config, 0, 0)
    index = torch.randperm(len(state.remembered), generator=random)[: config.strands_per_step].to(device)
    chosen = torch.randint(len(data.segments), (config.targets_per_step,), generator=random).to(device)
    strands = model.decode(config.step_points, index=index).points.detach()
    points, along = strands.reshape(-1, 3), directions(strands).reshape(-1, 3)
    others = state.remembered[config.strands_per_step :].reshape(-1, 3)

    def index_points() -> PointGrid:
        return PointGrid.build(torch.cat([points, others]), config.chamfer.radius)

    everything = index_points()
    seen = seen_points(model, state.remembered, data.views.cameras)[index].reshape(-1)
    target, _ = random_region(
        data, 0, config.crop, model.config.unet.stride, config.trimap, step_generator(config, 0, 1)
    )
    drawn = Strands(state.drawn, root_uv=model.root_uv)
    rendered = model.render(drawn, target.camera).rgb.detach()

    def decode_backward() -> None:
        model.zero_grad()
        model.decode(config.step_points, index=index).points.sum().backward()

    def render_backward() -> None:
        model.zero_grad()
        model.render(drawn, target.camera).rgb.sum().backward()

    found: dict[str, Callable[[], object]] = {
        "decode some strands, forward and backward": decode_backward,
        "index the points of all strands": index_points,
        "surface loss": lambda: surface_loss(
            points, along, seen, everything, config.step_points, data.targets, config.chamfer
        ),
        "which points views see": lambda: seen_points(model, state.remembered, data.views.cameras),
        "coverage loss": lambda: coverage_loss(points, along, everything, data.targets, chosen, config.chamfer),
        "head penalty": lambda: head_penalty(strands, data.distance, config.clearance),
        "decode all strands": model.decode,
        "read a region and its trimap": lambda: random_region(
            data, 0, config.crop, model.config.unet.stride, config.trimap, step_generator(config, 0, 1)
        ),
        "render a region, forward and backward": render_backward,
        "structural loss": lambda: structural_loss(rendered, target.image),
        "Adam over everything": state.optimiser.step,
    }
    return found, StepTwins(data.head.mesh, everything, data.targets.grid, strands, state.optimiser)


def beside_twins(found: dict[str, Callable[[], object]], twins: StepTwins, device: torch.device) -> list[Beside]:
    """The parts that have a twin or a peer, with it."""
    pairs = twins.of(found)
    return [beside(name, found[name], pair, device, runs=3) for name, pair in pairs.items()]


def growth(arguments: Arguments, data: FitData, config: FitConfig, device: torch.device) -> str:
    """Whole steps by the number of strands, the side of the region, and the number of photographs."""
    rows: list[tuple[object, ...]] = []
    clock = time.process_time if device.type == "cpu" else time.perf_counter

    def add(what: str, data: FitData, config: FitConfig) -> None:
        shape, image = (1e3 * median(step_seconds(data, config, share, 4, clock)) for share in (1.0, 0.0))
        rows.append((what, shape, image))

    for share in (4, 2, 1):
        fewer = replace(config, strands=config.strands // share, strands_per_step=config.strands_per_step // share)
        add(f"{fewer.strands} strands, {fewer.strands_per_step} a step", data, fewer)
    for side in (config.crop // 2, 2 * config.crop):
        add(f"regions of {side} x {side}", data, replace(config, crop=side))
    for views in (2 * VIEWS, 4 * VIEWS):
        with stand_in(arguments.preset, device, arguments.resolution, views) as (more, _):
            add(f"{views} photographs", more, config)
    unit = "processor ms" if device.type == "cpu" else "wall ms"
    return table((f"{unit} of a step, median", "shape", "image"), rows)


def main(arguments: Arguments) -> None:
    """Print the tables."""
    keep_freed_memory()  # as the command line does
    device = pick_device(arguments.device)
    with stand_in(arguments.preset, device, arguments.resolution) as (data, config):
        found, twins = parts(data, config)
        timings = {name: time_function(part, device) for name, part in found.items()}
        rows = [(name, timing.median, timing.fastest) for name, timing in timings.items()]
        for name, share in (("a whole shape step", 1.0), ("a whole image step", 0.0)):
            seconds = step_seconds(data, config, share)
            rows.append((name, median(seconds), min(seconds)))
        for name, middle, least in rows:
            sys.stdout.write(f"{name:48} median {1e3 * middle:8.1f} ms, least {1e3 * least:8.1f} ms\n")
        sys.stdout.write(f"peak memory {peak_memory(device) / 1e9:.2f} GB\n")
        if arguments.twins:
            sys.stdout.write(f"\n{beside_table(beside_twins(found, twins, device), device)}\n")
        if arguments.grow:
            sys.stdout.write(f"\n{growth(arguments, data, config, device)}\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
