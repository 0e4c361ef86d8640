"""Appearance alone, fitted to the true strands of a capture: PSNR, SSIM and LPIPS in the hair of held-out views.

    python benchmarks/appearance.py --capture ../shared/data/captures/sintel_bob --out appearance

Every fifth view is held out. Beside the fitted renderer, two baselines see the same strands and photographs: one colour
a strand, splatted; and the nearest training view, warped by the geometry. Prints one JSON object, and writes pictures
(rendered, photographed, and the two baselines side by side) and the fitted model under --out.
"""

import json
import sys
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import torch
import tyro
from torch.nn import functional as F

from neural_strands.capture.capture import Capture
from neural_strands.evaluation.image_metrics import psnr, ssim
from neural_strands.evaluation.lpips import Lpips, find_lpips
from neural_strands.evaluation.timing import peak_memory
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.model.files import save_hair_model
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.shading import ShadingConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.splat import splat
from neural_strands.raster.visible import visible_points
from neural_strands.scalp.chart import chart_faces
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import attach_roots
from neural_strands.training.appearance import AppearanceConfig, fit_appearance
from neural_strands.training.first_colours import strand_colours
from neural_strands.training.observation import Observation

EVERY = 5
"""One view in this many is held out."""


@dataclass(frozen=True)
class Arguments:
    """What to fit, for how long."""

    capture: Path = Path("../shared/data/captures/sintel_bob")
    """A capture with true strands and hair masks."""
    out: Path = Path("appearance")
    """Folder of the pictures and the fitted model."""
    scale: float = 1.0
    """Size of the photographs used, as a fraction of their own."""
    plain: bool = False
    """The strided UNet in place of the alias-free one."""
    widths: tuple[int, ...] = (16, 32, 48, 64)
    """Channels of the UNet's levels."""
    shading: ShadingConfig = field(default_factory=ShadingConfig)
    """The point shader."""
    textures: ScalpTextureConfig = field(default_factory=lambda: ScalpTextureConfig(appearance_knots=1))
    """The appearance texture."""
    supersample: int = 3
    """Line pixels for each image pixel, along each axis."""
    seed: int = 0
    """Of first weights, views and crops."""
    report_every: int = 250
    """Steps between scores of some held-out views on standard error."""
    fit: AppearanceConfig = field(default_factory=AppearanceConfig)
    """Steps and rates."""


def observation(capture: Capture, index: int, scale: float) -> Observation:
    """One photograph with its camera and mask, resized by area."""
    camera, image, mask = capture.cameras[index], capture.image(index), capture.hair_mask(index)
    if mask is None:
        sys.exit(f"{capture.folder}: view {index} has no hair mask; this benchmark needs them")
    width, height = round(camera.width * scale), round(camera.height * scale)
    planes = torch.cat([image, mask[..., None]], dim=-1).permute(2, 0, 1)[None]
    planes = F.interpolate(planes, size=(height, width), mode="area")[0].permute(1, 2, 0)
    return Observation(camera.resized(width, height), planes[..., :3], planes[..., 3])


def known_colours(model: HairModel, strands: Strands, targets: list[Observation]) -> torch.Tensor:
    """Mean colour of the pixels that each strand is seen at; of its nearest seen neighbours where it is never seen."""
    colours, weight = strand_colours(model, strands, targets)
    seen = weight > 0.5
    gap = torch.cdist(strands.root_uv[~seen], strands.root_uv[seen])
    colours[~seen] = colours[seen][gap.topk(4, largest=False).indices].mean(dim=1)
    return colours


def one_colour_a_strand(
    model: HairModel, strands: Strands, colours: torch.Tensor, camera: Camera, behind: torch.Tensor
) -> torch.Tensor:
    """Baseline: strands of one colour each, splatted as densely as the renderer does, over the fitted surround."""
    factor = model.config.supersample
    fine = camera.resized(camera.width * factor, camera.height * factor)
    lines = rasterise_lines(strands.points, fine, model.body(fine).depth, model.config.lines)
    visible = visible_points(lines, strands.points)
    pixels, _ = camera.project(visible.world)
    drawn = splat(pixels, colours[visible.strand], (camera.height, camera.width))
    alpha = (drawn.coverage / factor**2).clamp(max=1)[..., None]
    return alpha * drawn.features.permute(1, 2, 0) + (1 - alpha) * behind


def warped_neighbour(model: HairModel, strands: Strands, camera: Camera, targets: list[Observation]) -> torch.Tensor:
    """Baseline: every pixel takes its colour where the nearest training view sees the same point."""
    ahead = torch.stack([target.camera.rotation[2] for target in targets]) @ camera.rotation[2]
    source = targets[int(ahead.argmax())]
    body = model.body(camera)
    lines = rasterise_lines(strands.points, camera, body.depth, model.config.lines)
    depth = torch.minimum(lines.depth, body.depth)
    depth = torch.where(depth.isfinite(), depth, depth[lines.depth.isfinite()].median())
    pixels, _ = source.camera.project(camera.unproject(camera.pixel_centres(), depth))
    grid = 2 * pixels / torch.tensor([source.camera.width, source.camera.height]) - 1
    image = source.image.permute(2, 0, 1)[None]
    return F.grid_sample(image, grid[None], padding_mode="border", align_corners=False)[0].permute(1, 2, 0)


def scores(image: torch.Tensor, target: Observation, lpips: Lpips | None) -> list[float]:
    """PSNR, SSIM and LPIPS in the hair region."""
    hair = (target.mask > 0.5).float()
    image = image.clamp(0, 1)
    distance = float("nan") if lpips is None else float(lpips(image, target.image, hair))
    return [float(psnr(image, target.image, hair)), float(ssim(image, target.image, hair)), distance]


def summary(rows: list[list[float]]) -> dict[str, float]:
    """Means over the views."""
    means = torch.tensor(rows).mean(dim=0).tolist()
    return {name: round(value, 4) for name, value in zip(("psnr", "ssim", "lpips"), means, strict=True)}


def main(arguments: Arguments) -> None:
    """Fit, score, and print one JSON object."""
    capture = Capture.load(arguments.capture)
    if capture.ground_truth is None or capture.head is None or capture.scalp_faces is None:
        sys.exit(f"{arguments.capture}: expected head.obj, scalp_faces.json and ground_truth.npz")
    head = Head(capture.head, capture.scalp_faces, chart_faces(capture.head, capture.scalp_faces))
    roots = attach_roots(head, capture.ground_truth.points[:, 0])
    strands = replace(capture.ground_truth, root_uv=roots.uv)
    views = [observation(capture, index, arguments.scale) for index in range(len(capture))]
    held = [view for index, view in enumerate(views) if index % EVERY == EVERY - 1]
    train = [view for index, view in enumerate(views) if index % EVERY != EVERY - 1]
    config = HairModelConfig(
        unet=UNetConfig(arguments.widths, alias_free=not arguments.plain),
        shading=arguments.shading,
        textures=arguments.textures,
        supersample=arguments.supersample,
    )
    first = torch.Generator().manual_seed(arguments.seed)
    model = HairModel(config, roots, StrandGenerator(), capture.head, first)
    lpips, reason = find_lpips("squeeze", fetch=False)
    begin = time.perf_counter()
    steps = 0
    for loss in fit_appearance(model, strands, train, arguments.fit, first, lpips):
        steps += 1
        if steps % arguments.report_every == 0:
            with torch.no_grad():
                now = [scores(model.render(strands, target.camera).rgb, target, lpips) for target in held[1::3]]
            elapsed = (time.perf_counter() - begin) / 60
            sys.stderr.write(f"step {steps}, {elapsed:.1f} min: loss {loss:.4f}, held out {summary(now)}\n")
    seconds = time.perf_counter() - begin
    rows: dict[str, list[list[float]]] = {name: [] for name in ("model", "strand_colour", "warp")}
    save_hair_model(model, arguments.out / "model", {"benchmark": "appearance"})
    with torch.no_grad():
        colours = known_colours(model, strands, train)
        for target in held:
            output = model.render(strands, target.camera)
            pictures = {
                "model": output.rgb,
                "strand_colour": one_colour_a_strand(model, strands, colours, target.camera, output.behind_rgb),
                "warp": warped_neighbour(model, strands, target.camera, train),
            }
            for name, picture in pictures.items():
                rows[name].append(scores(picture, target, lpips))
            row = torch.cat([pictures["model"], target.image, pictures["strand_colour"], pictures["warp"]], dim=1)
            pixels = row.clamp(0, 1).mul(255).round().byte().numpy()[..., ::-1]
            cv2.imwrite(str(arguments.out / f"{Path(target.camera.name).stem}.png"), pixels)
        trained = [scores(model.render(strands, target.camera).rgb, target, lpips) for target in train[::EVERY]]
    figures = {
        "capture": capture.folder.name,
        "views": {"train": len(train), "held_out": len(held)},
        "held_out": {name: summary(values) for name, values in rows.items()},
        "train": summary(trained),
        "each_held_out": [[round(value, 4) for value in row] for row in rows["model"]],
        "steps": steps,
        "minutes": round(seconds / 60, 1),
        "threads": torch.get_num_threads(),
        "peak_gigabytes": round(peak_memory() / 1e9, 2),
        "lpips": reason or "squeeze",
    }
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
