"""Where the time of a frame goes: decode, body, lines, splat and image generator, in milliseconds, with peak memory.

    python benchmarks/speed/render.py --device cpu
    python benchmarks/speed/render.py --device cuda

The groom is made here: strands of the shipped generator on a hemisphere of 9 cm. A static frame renders strands that
were decoded before; a dynamic frame decodes them too. Then the cost is measured against strands and against pixels.
Each figure is the fastest of several runs. Prints one JSON object, or tables with `--table`. `beside_plain_torch` has
what stages take and, in turn with them, the naive twins of plain.py, in processor time on a CPU (`--no-twins` leaves it
out).
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import torch
import tyro
from beside import Beside, beside, beside_table, table
from plain import plain_torch

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.evaluation.timing import peak_memory, time_function
from neural_strands.fitting.config import KNOTTED
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.frames import orthonormal_frames
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model import hair_model as hair_model_module
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.hair_volume import hair_volume
from neural_strands.model.renderer import HairRenderer
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.vae import load_prior
from neural_strands.raster.lines import LineBuffer, LineConfig, rasterise_lines
from neural_strands.raster.splat import SplatMap
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.raster.visible import visible_points
from neural_strands.scalp.roots import Roots

RADIUS = 0.09
"""Radius of the head, metres."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    device: DeviceName = "cpu"
    """Where."""
    strands: int | None = None
    """Strands; by default 10,000 on the CPU and 30,000 on CUDA."""
    size: int | None = None
    """Side of the image, pixels; by default 256 on the CPU and 1024 on CUDA."""
    widths: tuple[int, ...] | None = None
    """Channels of the UNet's levels; by default those of the CPU preset, or twice as many on CUDA."""
    supersample: int = HairModelConfig().supersample
    """Line pixels for each image pixel, along each axis."""
    lines: LineConfig = field(default_factory=lambda: LineConfig(width=2.5e-4, tip=0.33))
    """Width of strands, metres; about what fits estimate."""
    runs: int = 10
    """Measured runs of each figure."""
    compile: bool = False
    """Run the UNet through torch.compile (CUDA)."""
    twins: bool = True
    """Run the naive twins, too."""
    table: bool = False
    """Print tables instead of JSON."""


def ball(rings: int = 24) -> Mesh:
    """A sphere of latitude rings."""
    theta = torch.linspace(0, torch.pi, rings + 1)[:, None]
    phi = torch.arange(2 * rings) * (torch.pi / rings)
    vertices = RADIUS * torch.stack(
        [theta.sin() * phi.cos(), theta.cos().expand(-1, 2 * rings), theta.sin() * phi.sin()], dim=-1
    )
    row, column = torch.meshgrid(torch.arange(rings), torch.arange(2 * rings), indexing="ij")
    after = (column + 1) % (2 * rings)
    a, b = row * 2 * rings + column, row * 2 * rings + after
    c, d = a + 2 * rings, b + 2 * rings
    faces = torch.stack([torch.stack([a, b, c], dim=-1), torch.stack([b, d, c], dim=-1)]).reshape(-1, 3)
    return Mesh(vertices.reshape(-1, 3), faces)


def hemisphere(count: int, random: torch.Generator) -> Roots:
    """Roots all over the upper half of the ball."""
    height, turn = torch.rand(2, count, generator=random)
    ring, angle = (1 - height.square()).sqrt(), 2 * torch.pi * turn
    normal = torch.stack([ring * angle.cos(), height, ring * angle.sin()], dim=1)
    uv = 0.5 + 0.5 * ((1 - height).sqrt())[:, None] * torch.stack([angle.cos(), angle.sin()], dim=1)
    down = torch.tensor([0.0, -1.0, 0.0]).expand_as(normal)
    return Roots(RADIUS * normal, uv, orthonormal_frames(normal, down), torch.zeros(count))


def hair_model(strands: int, arguments: Arguments, device: torch.device) -> HairModel:
    """A model with random hair, and the requested supersampling and widths."""
    random = torch.Generator().manual_seed(0)
    narrow = UNetConfig().widths
    widths = arguments.widths or (narrow if device.type == "cpu" else tuple(2 * width for width in narrow))
    config = HairModelConfig(
        textures=KNOTTED, unet=UNetConfig(widths), lines=arguments.lines, supersample=arguments.supersample
    )
    prior = load_prior()
    # As in a fit's model, whose texture holds what the modulator puts out.
    generator = prior.without_modulator().generator
    model = HairModel(config, hemisphere(strands, random), generator, ball(), random)
    with torch.no_grad():
        shape = model.textures.shape
        shape.copy_(prior.generator.modulator(torch.randn(shape.flatten(0, 1).shape, generator=random)).view_as(shape))
        model.textures.appearance.normal_(generator=random)
    model = model.to(device).eval()
    if arguments.compile:
        model.unet.compile()
    return model


def stages(model: HairModel, camera: Camera) -> dict[str, Callable[[], object]]:
    """Each stage of a frame, and whole frames."""
    factor = model.config.supersample
    renderer = HairRenderer.of(model)
    strands, volume = renderer.strands, renderer.volume
    fine = camera.resized(camera.width * factor, camera.height * factor)
    body = model.body(fine)
    lines = rasterise_lines(strands.points, fine, body.depth, model.lines)

    def drawn() -> LineBuffer:
        return hair_model_module.rasterise_lines(strands.points, fine, body.depth, model.lines)

    def splatted() -> list[SplatMap]:
        visible = visible_points(lines, strands.points, factor, strands.t)
        return model.splat_descriptors(strands, visible, camera, model.viewpoint(camera), volume=volume)

    maps = splatted()
    return {
        "decode": model.decode,
        "body": lambda: model.body.colours(rasterise_triangles(model.body.vertices, model.body.faces, fine), factor),
        "lines": drawn,
        "volume": lambda: hair_volume(strands.points),
        "splat": splatted,
        "unet": lambda: model.generate(maps, camera),
        "static_frame": lambda: renderer.render(camera),
        # With the room of the frame before, as wherever strands move.
        "dynamic_frame": lambda: replace(HairRenderer.of(model), room=renderer.room).render(camera),
    }


def frame_times(model: HairModel, camera: Camera, runs: int) -> dict[str, float]:
    """Milliseconds of each stage and of whole frames."""
    device = model.root_uv.device
    return {
        name: round(1e3 * time_function(run, device, runs, 2).fastest, 2) for name, run in stages(model, camera).items()
    }


def beside_plain(model: HairModel, camera: Camera, runs: int) -> list[Beside]:
    """The stages that plain torch does otherwise, beside it."""
    device = model.root_uv.device

    def plain(run: Callable[[], object]) -> Callable[[], None]:
        def work() -> None:
            with plain_torch():
                run()

        return work

    found, changed = stages(model, camera), ("decode", "lines", "splat", "unet", "static_frame", "dynamic_frame")
    return [beside(name, found[name], ("plain torch", plain(found[name])), device, runs) for name in changed]


def as_tables(figures: dict[str, Any], device: torch.device, twins: list[Beside]) -> str:
    """The figures for people."""
    heads = [f"{name}: {figures[name]}" for name in ("device", "strands", "size", "supersample", "peak_gigabytes")]
    parts = [", ".join(heads), table(("wall ms", "fastest"), list(figures["milliseconds"].items()))]
    for name, what in (("by_pixels", "side, pixels"), ("by_strands", "strands")):
        parts.append(table((what, "static frame, wall ms"), list(figures[name].items())))
    return "\n\n".join([*parts, *([beside_table(twins, device)] if twins else [])])


def view(model: HairModel, side: int) -> Camera:
    """The hair from in front, filling the image."""
    return turntable_cameras(model.decode().points.detach(), 1, (side, side))[0]


def main(arguments: Arguments) -> None:
    """Measure and print one JSON object."""
    keep_freed_memory()  # as the command line does
    device = pick_device(arguments.device)
    on_gpu = device.type == "cuda"
    strands = arguments.strands or (30_000 if on_gpu else 10_000)
    side = arguments.size or (1024 if on_gpu else 256)
    with torch.no_grad():
        model = hair_model(strands, arguments, device)
        figures = {
            "device": torch.cuda.get_device_name(device) if on_gpu else f"cpu, {torch.get_num_threads()} threads",
            "strands": strands,
            "size": side,
            "supersample": arguments.supersample,
            "milliseconds": frame_times(model, view(model, side), arguments.runs),
            "peak_gigabytes": round(peak_memory(device) / 1e9, 3),
            "by_pixels": {
                str(pixels): frame_times(model, view(model, pixels), arguments.runs)["static_frame"]
                for pixels in (side // 2, side, 2 * side)
            },
        }
        figures["by_strands"] = {
            str(count): frame_times(few, view(few, side), arguments.runs)["static_frame"]
            for count in (strands // 4, strands // 2, strands)
            for few in (hair_model(count, arguments, device),)
        }
        if arguments.supersample != 1:
            plain = hair_model(strands, replace(arguments, supersample=1, lines=LineConfig()), device)
            figures["without_supersampling"] = frame_times(plain, view(plain, side), arguments.runs)
        twins = beside_plain(model, view(model, side), max(arguments.runs // 3, 1)) if arguments.twins else []
        figures["beside_plain_torch"] = {row.what: [row.ours, row.theirs] for row in twins}
    sys.stdout.write((as_tables(figures, device, twins) if arguments.table else json.dumps(figures)) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
