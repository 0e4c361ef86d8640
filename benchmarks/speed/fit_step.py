"""Cost of one step of the fit, part by part: `python benchmarks/speed/fit_step.py [--preset fast] [--device cpu]`.

Stand-in segments above the built-in mannequin and grey photographs: no data is needed, the work is that of a real step.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
import tyro

from neural_strands.capture.capture import Capture
from neural_strands.capture.writer import CaptureWriter
from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.evaluation.timing import Timing, time_function
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


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    preset: Preset = "fast"
    """Settings of the fit."""
    device: DeviceName = "cpu"
    """Device."""
    resolution: int = 512
    """Side of the photographs, pixels."""


def grey_capture(folder: Path, points: torch.Tensor, resolution: int) -> None:
    """A capture of eight grey photographs of that size."""
    writer, cameras = CaptureWriter(folder), dome(points, DomeConfig(8, resolution))
    for camera in cameras:
        writer.write_view(camera, np.full((resolution, resolution, 3), 128, np.uint8))
    writer.finish(cameras)


def measure(data: FitData, config: FitConfig, device: torch.device) -> list[tuple[str, Timing]]:
    """Time the parts of a shape step and of an image step."""
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

    parts = {
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
    rows = [(name, time_function(part, device)) for name, part in parts.items()]
    for name, share in (("a whole shape step", 1.0), ("a whole image step", 0.0)):
        trial = replace(config, steps=12, shape_every=100, schedule=replace(config.schedule, geometry_only=share))
        fresh = begin(data, load_prior(device=device), trial)
        seconds: list[float] = []
        fit(fresh, data, trial, structural_loss, after_step=lambda _, row, out=seconds: out.append(row["seconds"]))
        kept = sorted(seconds[2:])
        rows.append((name, Timing(kept[len(kept) // 2], kept[0], kept[-1], len(kept), rows[-1][1].peak_bytes)))
    return rows


def main(arguments: Arguments) -> None:
    """Print the table."""
    keep_freed_memory()  # as the command line does
    device = pick_device(arguments.device)
    config = replace(preset(arguments.preset), initialise="mean", hold_out_every=0)
    head = mannequin()
    roots = sample_roots(head, SEGMENT_POINTS, torch.Generator().manual_seed(0))
    lifted = roots.position + 0.01 * roots.normal
    number = torch.arange(len(lifted))
    segments = LineSegments(lifted, roots.frame[..., 0].contiguous(), torch.ones(len(lifted)), number)
    with TemporaryDirectory() as folder:
        grey_capture(Path(folder), lifted, arguments.resolution)
        data = gather_fit_data(Capture.load(folder), head, segments, config, device)
        rows = measure(data, config, device)
    for name, timing in rows:
        sys.stdout.write(f"{name:48} median {1e3 * timing.median:8.1f} ms, least {1e3 * timing.fastest:8.1f} ms\n")
    sys.stdout.write(f"peak memory {rows[-1][1].peak_bytes / 1e9:.2f} GB\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
