"""Flicker of fitted models on a slow turntable: changes between frames that the known motion does not explain.

    python benchmarks/quality/appearance.py --out smooth ...
    python benchmarks/quality/appearance.py --out strided --plain ...
    python benchmarks/quality/flicker.py --models smooth/model strided/model --capture CAPTURE

Neighbouring frames are compared where both see the same hair: the second is sampled (bicubic) where the strands' points
of the first project to. Reported are the root mean square difference in 8-bit levels over the interior of the hair, and
the contrast of fine detail beside it, as a blurred picture flickers less. Prints one JSON object.
"""

import itertools
import json
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import tyro
from torch.nn import functional as F

from neural_strands.capture.capture import Capture
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model.files import load_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.model.outputs import RenderOutput
from neural_strands.model.renderer import HairRenderer

SAME_DEPTH = 0.002
"""Largest distance between points of the same surface in two frames, metres."""
INTERIOR = 0.9
"""Coverage, averaged over 7 x 7 pixels, above which a pixel is inside the hair."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    models: tuple[Path, ...]
    """Folders of fitted models."""
    capture: Path | None = None
    """Capture whose true strands are used instead of the model's own."""
    frames: int = 12
    """Frames of each turn."""
    step: float = 0.25
    """Degrees between frames."""
    starts: tuple[float, ...] = (0.0, 90.0, 180.0)
    """Starting angles of the turns, degrees from the front."""
    size: int = 512
    """Side of the image, pixels."""


def depth_image(model: HairModel, output: RenderOutput) -> torch.Tensor:
    """Nearest strand of each pixel, metres."""
    factor = model.config.supersample
    return -F.max_pool2d(-output.lines.depth[None, None], factor)[0, 0]


def sampled(image: torch.Tensor, pixels: torch.Tensor, mode: str) -> torch.Tensor:
    """Values of an image (height, width, channel) at pixel coordinates."""
    height, width = image.shape[:2]
    grid = 2 * pixels / torch.tensor([width, height]) - 1
    return F.grid_sample(image.permute(2, 0, 1)[None], grid[None], mode=mode, align_corners=False)[0].permute(1, 2, 0)


def changes(
    model: HairModel, before: tuple[Camera, RenderOutput], after: tuple[Camera, RenderOutput]
) -> tuple[torch.Tensor, torch.Tensor]:
    """Squared differences (pixel, 3) of the second frame, warped onto the first, at pixels that show the same hair."""
    camera, output = before
    inside = F.avg_pool2d(output.coverage[None, None], 7, 1, 3, count_include_pad=False)[0, 0] > INTERIOR
    depth = depth_image(model, output)
    inside &= depth.isfinite()
    world = camera.unproject(camera.pixel_centres(), torch.where(inside, depth, torch.ones(())))
    pixels, ahead = after[0].project(world)
    there = sampled(depth_image(model, after[1]).nan_to_num(posinf=1e3)[..., None], pixels, "nearest")[..., 0]
    same = inside & ((there - ahead).abs() < SAME_DEPTH)
    moved = sampled(after[1].rgb.clamp(0, 1), pixels, "bicubic")
    return (moved - output.rgb.clamp(0, 1))[same].square(), same


def detail(image: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Squared Laplacian of the luma inside the hair: the fine contrast that could flicker."""
    kernel = torch.tensor([[0.0, 1.0, 0.0], [1.0, -4.0, 1.0], [0.0, 1.0, 0.0]])[None, None]
    luma = image.clamp(0, 1).mean(dim=-1)[None, None]
    return F.conv2d(luma, kernel, padding=1)[0, 0][inside].square()


def turn(renderer: HairRenderer, arguments: Arguments, start: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Squared changes and squared detail over one turn."""
    whole = round(360 / arguments.step)
    first = round(start / arguments.step)
    cameras = turntable_cameras(renderer.strands.points, whole, (arguments.size, arguments.size))
    cameras = (cameras * 2)[first : first + arguments.frames]
    frames = [(camera, renderer.render(camera)) for camera in cameras]
    squares, contrast = [], []
    for before, after in itertools.pairwise(frames):
        square, same = changes(renderer.model, before, after)
        squares.append(square.mean(dim=1))
        contrast.append(detail(before[1].rgb, same))
    return torch.cat(squares), torch.cat(contrast)


def main(arguments: Arguments) -> None:
    """Measure every model and print one JSON object."""
    figures = {}
    for folder in arguments.models:
        model = load_hair_model(folder)
        with torch.no_grad():
            strands = None
            if arguments.capture is not None:
                truth = Capture.load(arguments.capture).ground_truth
                if truth is None:
                    sys.exit(f"{arguments.capture}: expected ground_truth.npz")
                strands = replace(truth, root_uv=model.root_uv)
            renderer = HairRenderer.of(model, strands)
            parts = [turn(renderer, arguments, start) for start in arguments.starts]
        squares, contrast = (torch.cat(column) for column in zip(*parts, strict=True))
        flicker, fine = (255 * math.sqrt(float(values.mean())) for values in (squares, contrast))
        figures[str(folder)] = {
            "alias_free": model.config.unet.alias_free,
            "flicker_levels": round(flicker, 3),
            "detail_levels": round(fine, 3),
            "flicker_over_detail": round(flicker / fine, 4),
            "pixels": len(squares),
        }
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
