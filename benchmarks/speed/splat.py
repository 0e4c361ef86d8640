"""The static raster part of a frame: lines, visible points, splat pyramid and its backward pass, with peak memory.

python benchmarks/speed/splat.py [--device cpu|cuda]
"""

from dataclasses import dataclass
from statistics import median

import torch
import tyro
from lines import groom, peak_megabytes, timed, view

from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.splat import splat_pyramid
from neural_strands.raster.visible import visible_points


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    device: str = "cpu"
    """cpu or cuda."""
    repeats: int = 20
    """Timed runs of each setting."""
    channels: int = 20
    """Channels splatted."""
    levels: int = 4
    """Resolutions splatted."""


def measure(arguments: Arguments, strands: int, size: int) -> str:
    """Time every step of one setting."""
    device, repeats = arguments.device, arguments.repeats
    points, camera = groom(strands).to(device).requires_grad_(), view(size).to(device)
    buffer = rasterise_lines(points, camera)
    visible = visible_points(buffer, points)
    pixels = camera.project(visible.world)[0].detach().requires_grad_()
    features = torch.randn(len(visible), arguments.channels, generator=torch.Generator().manual_seed(0))
    features = features.to(device).requires_grad_()
    planes = [plane for found in splat_pyramid(pixels, features, (size, size), arguments.levels) for plane in found]
    cotangents = [torch.ones_like(plane) for plane in planes]
    steps = {
        "lines": lambda: rasterise_lines(points, camera),
        "visible": lambda: visible_points(buffer, points),
        "splat": lambda: splat_pyramid(pixels, features, (size, size), arguments.levels),
        "back": lambda: torch.autograd.grad(planes, [pixels, features], cotangents, retain_graph=True),
    }
    times = {name: timed(step, repeats, device) for name, step in steps.items()}
    figures = "  ".join(f"{name} {median(ms):.2f} ({min(ms):.2f})" for name, ms in times.items())
    memory = f"peak {peak_megabytes(device):.0f} MB"
    return f"{strands} strands, {size} x {size}, {len(visible)} points: {figures}  {memory}"


def main(arguments: Arguments) -> None:
    print(f"device {arguments.device}, torch threads {torch.get_num_threads()}; median (least) ms")
    for strands, size in ((5_000, 512), (10_000, 256), (10_000, 512), (20_000, 512), (30_000, 1024)):
        print(measure(arguments, strands, size))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
