"""The static raster part of a frame: lines, visible points, splat pyramid and its backward pass, with peak memory.

    python benchmarks/speed/splat.py [--device cpu|cuda]

Grows with strands and pixels. Then the splat of one setting beside its naive twin, scattered sums of torch.
"""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import torch
import tyro
from beside import Beside, beside, beside_table
from lines import groom, peak_megabytes, timed, view

from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.splat import SplatMap, splat_pyramid, splat_pyramid_reference
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


@dataclass(frozen=True)
class Scattered:
    """Points of a groom with features, to be splatted."""

    pixels: torch.Tensor
    features: torch.Tensor
    size: int
    levels: int

    def planes(self, splat: Callable[..., list[SplatMap]]) -> list[torch.Tensor]:
        """All maps."""
        maps = splat(self.pixels, self.features, (self.size, self.size), self.levels)
        return [plane for found in maps for plane in found]

    def gradients(self, splat: Callable[..., list[SplatMap]]) -> tuple[torch.Tensor, ...]:
        """Of the sum of all maps, maps included."""
        planes = self.planes(splat)
        return torch.autograd.grad(planes, [self.pixels, self.features], [torch.ones_like(plane) for plane in planes])


def scattered(arguments: Arguments, strands: int, size: int) -> Scattered:
    """The visible points of a groom."""
    points, camera = groom(strands).to(arguments.device), view(size).to(arguments.device)
    visible = visible_points(rasterise_lines(points, camera), points)
    features = torch.randn(len(visible), arguments.channels, generator=torch.Generator().manual_seed(0))
    pixels = camera.project(visible.world)[0].detach().requires_grad_()
    return Scattered(pixels, features.to(arguments.device).requires_grad_(), size, arguments.levels)


def twins(arguments: Arguments, strands: int = 10_000, size: int = 512) -> str:
    """The splat of one setting beside its twin; both give the same."""
    work, twin, runs = scattered(arguments, strands, size), "scattered sums of torch", max(arguments.repeats // 4, 1)
    for ours, theirs in zip(work.gradients(splat_pyramid), work.gradients(splat_pyramid_reference), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-3, rtol=1e-3)

    def compared(name: str, run: Callable[[Callable], object]) -> Beside:
        theirs = (twin, lambda: run(splat_pyramid_reference))
        return beside(name, lambda: run(splat_pyramid), theirs, arguments.device, runs)

    with torch.no_grad():
        forward = compared("forward", work.planes)
    both = compared("forward and backward", work.gradients)
    heading = f"splat of {strands} strands, {size} x {size}, {len(work.pixels)} points"
    return f"{heading}\n{beside_table([forward, both], arguments.device)}"


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
    print(f"\n{twins(arguments)}")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
