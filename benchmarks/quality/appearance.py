"""Appearance alone, fitted to the true strands of a capture: PSNR, SSIM and LPIPS in the hair of held-out views.

    python benchmarks/quality/appearance.py --capture ../shared/data/captures/sintel_bob --out appearance

Every fifth view is held out. The fitted renderer is compared with two baselines that get the same strands and
photographs: one colour per strand, splatted; and the nearest training view, warped by the geometry. Its pictures are
compared with grain, as by `evaluate`, and without. Prints one JSON object, and writes pictures (rendered without grain,
photographed, and the two baselines side by side) and the fitted model under --out.
"""

import json
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
import tyro
from torch.nn import functional as F

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import held_out_views, training_views
from neural_strands.evaluation.lpips import Lpips, find_lpips
from neural_strands.evaluation.timing import peak_memory
from neural_strands.evaluation.view_quality import image_quality
from neural_strands.fitting.config import KNOTTED, FitConfig, FitWeights
from neural_strands.fitting.first_colours import photographed_colours
from neural_strands.fitting.fit import FitState, fit, start_fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.foundation.srgb import to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands, directions
from neural_strands.geometry.views import View
from neural_strands.model.files import save_hair_model
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.renderer import HairRenderer
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.shading import ShadingConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.pictures.encoding import write_png
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.raster.splat import splat
from neural_strands.raster.visible import visible_points
from neural_strands.runs.evaluate import GRAIN
from neural_strands.scalp.roots import attach_roots


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Path = Path("../shared/data/captures/sintel_bob")
    """A capture with true strands and hair masks."""
    out: Path = Path("appearance")
    """Folder of the pictures and the fitted model."""
    plain: bool = False
    """The strided UNet in place of the alias-free one."""
    widths: tuple[int, ...] = (16, 32)
    """Channels of the UNet's levels."""
    shading: ShadingConfig = field(default_factory=ShadingConfig)
    """The point shader."""
    textures: ScalpTextureConfig = KNOTTED
    """The appearance texture."""
    supersample: int = 4
    """Line pixels for each image pixel, along each axis."""
    steps: int = 5000
    """Gradient steps, one region each."""
    crop: int = 160
    """Side of a region, pixels."""
    perceptual: float = 0.06
    """Weight of LPIPS."""
    perceptual_from: float = 0.5
    """Share of the steps after which LPIPS counts."""
    blur_until: float = 1.0
    """Share of the steps after which the appearance texture's gradient is no longer blurred."""
    seed: int = 0
    """Seed of initial weights, views and regions."""
    report_every: int = 250
    """Steps between scores of some held-out views on standard error."""

    def config(self) -> FitConfig:
        """The config of the end-to-end fit, with fixed shape and image losses from the first step."""
        model = HairModelConfig(
            textures=self.textures,
            unet=UNetConfig(self.widths, alias_free=not self.plain),
            shading=self.shading,
            # The artists' strands thin to their tips.
            lines=LineConfig(tip=0.33),
            supersample=self.supersample,
        )
        return FitConfig(
            steps=self.steps,
            crop=self.crop,
            shape_every=0,
            seed=self.seed,
            weights=FitWeights(perceptual=self.perceptual),
            schedule=ScheduleConfig(
                geometry_only=0.0,
                appearance_blur_until=self.blur_until,
                perceptual_from=self.perceptual_from,
                final_rate=0.02,
            ),
            model=model,
        )


def strand_segments(strands: Strands) -> LineSegments:
    """The true strands as line segments, for trimaps and checks."""
    count, points = strands.points.shape[:2]
    number = torch.arange(count).repeat_interleave(points)
    along = directions(strands.points)
    return LineSegments(strands.points.flatten(0, 1), along.flatten(0, 1), torch.ones(count * points), number)


def known_colours(model: HairModel, strands: Strands, targets: list[View]) -> torch.Tensor:
    """Mean colour of the pixels that see each strand; unseen strands take that of their nearest seen neighbours."""
    colours, weight = photographed_colours(model, strands, targets)
    seen = weight > 0.5
    uv = model.root_uv
    gap = torch.cdist(uv[~seen], uv[seen])
    colours[~seen] = colours[seen][gap.topk(4, largest=False).indices].mean(dim=1)
    return colours


def one_colour_a_strand(
    model: HairModel, strands: Strands, colours: torch.Tensor, camera: Camera, behind: torch.Tensor
) -> torch.Tensor:
    """Baseline: one linear colour per strand, splatted as densely as by the renderer, over the fitted surround."""
    factor = model.config.supersample
    fine = camera.resized(camera.width * factor, camera.height * factor)
    lines = rasterise_lines(strands.points, fine, model.body(fine).depth, model.lines)
    visible = visible_points(lines, strands.points, factor)
    pixels, _ = camera.project(visible.world)
    drawn = splat(pixels, colours[visible.strand], (camera.height, camera.width), amounts=visible.weight)
    alpha = (drawn.coverage / factor**2).clamp(max=1)[..., None]
    return to_srgb(alpha * drawn.features.permute(1, 2, 0) + (1 - alpha) * behind)


def warped_neighbour(model: HairModel, strands: Strands, camera: Camera, targets: list[View]) -> torch.Tensor:
    """Baseline: every pixel takes the colour of the same point in the nearest training view."""
    ahead = torch.stack([target.camera.rotation[2] for target in targets]) @ camera.rotation[2]
    source = targets[int(ahead.argmax())]
    body = model.body(camera)
    lines = rasterise_lines(strands.points, camera, body.depth)
    depth = torch.minimum(lines.depth, body.depth)
    depth = torch.where(depth.isfinite(), depth, depth[lines.depth.isfinite()].median())
    pixels, _ = source.camera.project(camera.unproject(camera.pixel_centres(), depth))
    grid = 2 * pixels / torch.tensor([source.camera.width, source.camera.height]) - 1
    image = source.image.permute(2, 0, 1)[None]
    return F.grid_sample(image, grid[None], padding_mode="border", align_corners=False)[0].permute(1, 2, 0)


def grainy(renderer: HairRenderer, target: View) -> torch.Tensor:
    """The picture that is compared with a photograph."""
    return renderer.with_grain(renderer.render(target.camera), GRAIN).rgb


def scores(image: torch.Tensor, target: View, lpips: Lpips | None) -> list[float]:
    """PSNR, SSIM and LPIPS in the hair region."""
    if target.hair_mask is None:
        raise SystemExit(f"{target.camera.name}: expected a hair mask, found none; choose a capture with masks.")
    quality = image_quality(image.clamp(0, 1), target.image, lpips, target.hair_mask > 0.5)
    return [quality.psnr, quality.ssim, float("nan") if quality.lpips is None else quality.lpips]


def summary(rows: list[list[float]]) -> dict[str, float]:
    """Means over the views."""
    means = torch.tensor(rows).mean(dim=0).tolist()
    return {name: round(value, 4) for name, value in zip(("psnr", "ssim", "lpips"), means, strict=True)}


def main(arguments: Arguments) -> None:
    """Fit, score, and print one JSON object."""
    keep_freed_memory()  # as the command line does
    capture, config = Capture.load(arguments.capture), arguments.config()
    if capture.ground_truth is None:
        sys.exit(f"{arguments.capture}: expected ground_truth.npz, found none")
    head = find_head(capture)
    roots = attach_roots(head, capture.ground_truth.points[:, 0])
    strands = replace(capture.ground_truth, root_uv=roots.uv)
    views = capture.views_on("cpu")
    held = [views[index] for index in held_out_views(len(capture), config.hold_out_every)]
    train = [views[index] for index in training_views(len(capture), config.hold_out_every)]
    first = torch.Generator().manual_seed(arguments.seed)
    model = HairModel(config.model, roots, StrandGenerator(), head.mesh, first)
    lpips, reason = find_lpips("squeeze", fetch=False)
    begin = time.perf_counter()

    def report(state: FitState, figures: dict[str, float]) -> None:
        if state.step % arguments.report_every == 0:
            with torch.no_grad():
                renderer = HairRenderer.of(model, strands)
                now = [scores(grainy(renderer, target), target, lpips) for target in held[1::3]]
            elapsed = (time.perf_counter() - begin) / 60
            loss = sum(figures[name] for name in ("render", "perceptual", "alpha"))
            sys.stderr.write(f"step {state.step}, {elapsed:.1f} min: loss {loss:.4f}, held out {summary(now)}\n")

    state = start_fit(model, config)
    state.show(strands.points)
    data = gather_fit_data(capture, head, strand_segments(strands), config, torch.device("cpu"))
    fit(state, data, config, lpips, after_step=report)
    seconds = time.perf_counter() - begin
    rows: dict[str, list[list[float]]] = {name: [] for name in ("model", "without_grain", "strand_colour", "warp")}
    save_hair_model(model, arguments.out / "model", {"benchmark": "appearance"})
    with torch.no_grad():
        colours = known_colours(model, strands, train)
        renderer = HairRenderer.of(model, strands)
        for target in held:
            output = renderer.render(target.camera)
            pictures = {
                "model": renderer.with_grain(output, GRAIN).rgb,
                "without_grain": output.rgb,
                "strand_colour": one_colour_a_strand(model, strands, colours, target.camera, output.behind_rgb),
                "warp": warped_neighbour(model, strands, target.camera, train),
            }
            for name, picture in pictures.items():
                rows[name].append(scores(picture, target, lpips))
            baselines = (pictures["strand_colour"], pictures["warp"])
            row = torch.cat([output.rgb, target.image, *baselines], dim=1)
            write_png((arguments.out / target.camera.name).with_suffix(".png"), row)
        trained = [scores(grainy(renderer, target), target, lpips) for target in train[::5]]
    figures = {
        "capture": capture.folder.name,
        "views": {"train": len(train), "held_out": len(held)},
        "held_out": {name: summary(values) for name, values in rows.items()},
        "train": summary(trained),
        "each_held_out": [[round(value, 4) for value in row] for row in rows["model"]],
        "steps": state.step,
        "minutes": round(seconds / 60, 1),
        "threads": torch.get_num_threads(),
        "peak_gigabytes": round(peak_memory() / 1e9, 2),
        "lpips": reason or "squeeze",
    }
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
