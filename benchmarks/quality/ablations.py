"""The effect of each part of the fit: variants with one change, on one capture, side by side.

    python benchmarks/quality/ablations.py CAPTURE OUT [--only NAME ...] [--steps 300] [--positions-prior FILE]

All variants share line segments (made once, kept in OUT), seed and number of steps. A variant that is finished in OUT
is not run again, one that was stopped goes on from its checkpoint. Writes OUT/table.txt, OUT/table.json and
OUT/ablations.png: the strands of each variant and its rendering of a held-out view, beside the photograph.

Shape: "full"; "no coarse-to-fine, no root-to-tip"; "geometry alone" (images train the appearance, not the strands);
"positions" (a generator whose output is positions, not gradients: FILE is what `neural-strands train-prior FILE
--config.generator.synthesiser.output position` wrote). Images: "random networks" (a start without what the shipped
ones have learned); "strided UNet", which starts from random weights, too; "no alpha loss". These begin from strands
traced through the segments, which leaves little to the order in which shape is freed; so the paper's start, its mean
strand at every root, is run with its coarse-to-fine and root-to-tip schedule and without.
"""

import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro
from matplotlib.figure import Figure
from matplotlib.image import imread

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import training_views
from neural_strands.fitting.config import FitConfig, Preset, preset
from neural_strands.fitting.first_model import fit_prior
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.fitting.stereo import find_segments, segments_source
from neural_strands.foundation.files import atomic_file, write_json
from neural_strands.foundation.progress import Feedback, track
from neural_strands.lmvs.files import save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.pictures.lines import lines_picture
from neural_strands.pictures.plots import DPI, figure_image
from neural_strands.runs.evaluate import RunContents, evaluate_run, open_run
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.runs.run_folder import weights_digest

CPU = torch.device("cpu")
SHOWN = 2
"""Held-out view that the pictures show."""
MARGIN = 0.06
"""Share of the picture's side that is shown around the hair."""


@dataclass(frozen=True)
class Variant:
    """One column of the table.

    Attributes:
        config: of its fit.
        prior: weights of its strand prior, if they are not the package's.
    """

    config: FitConfig
    prior: Path | None = None


def variants(base: FitConfig, positions: Path | None) -> dict[str, Variant]:
    """All variants by name; `positions` are the weights of a generator of positions, if there are any."""
    free = replace(base.schedule, widest_blur=0.0, release_until=0.0)
    strided = replace(base.model, unet=replace(base.model.unet, alias_free=False))
    mean = mean_start(base)
    at_once = replace(mean.schedule, widest_blur=0.0, release_until=0.0)
    configs = {
        "full": Variant(base),
        "no coarse-to-fine, no root-to-tip": Variant(replace(base, schedule=free)),
        "geometry alone": Variant(replace(base, weights=replace(base.weights, shape_from_image=0.0))),
        "positions": Variant(base, positions),
        "random networks": Variant(replace(base, networks="random")),
        "strided UNet": Variant(replace(base, model=strided, networks="random")),
        "no alpha loss": Variant(replace(base, weights=replace(base.weights, alpha=0.0))),
        "mean start": Variant(mean),
        "mean start, no coarse-to-fine, no root-to-tip": Variant(replace(mean, schedule=at_once)),
    }
    return {name: variant for name, variant in configs.items() if name != "positions" or positions is not None}


def mean_start(base: FitConfig) -> FitConfig:
    """The paper's start: strands far from the segments, which see each other from farther away and learn faster."""
    schedule = ScheduleConfig(geometry_only=base.schedule.geometry_only)
    chamfer = replace(base.chamfer, radius=0.05, surface_radius=0.01)
    rates = replace(base.rates, shape=5 * base.rates.shape)
    return replace(base, initialise="mean", schedule=schedule, chamfer=chamfer, rates=rates)


def shared_segments(capture: Capture, out: Path, config: FitConfig) -> Path:
    """Load or make the line segments of the training views."""
    path = out / "segments.npz"
    if not path.is_file():
        seen = capture.subset(training_views(len(capture), config.hold_out_every))
        segments = find_segments(seen, find_head(capture, None), config, out / "lmvs", track)
        save_segments(path, segments, segments_source(seen, config))
    return path


def folder_name(name: str) -> str:
    """Folder name of a variant."""
    return "_".join("".join(letter if letter.isalnum() else " " for letter in name).split())


def run_variant(name: str, variant: Variant, capture: Path, out: Path) -> None:
    """Fit, evaluate and draw one variant, unless it is finished; OUT/NAME/figures.json is written last."""
    run = out / folder_name(name)
    finished = run / "figures.json"
    described = json.loads(
        json.dumps({**asdict(variant.config), "prior": weights_digest(fit_prior(variant.prior, CPU))})
    )
    if finished.is_file():
        if json.loads(finished.read_text())["described"] != described:
            raise SystemExit(f"{run}: was made with other settings; delete it, or choose another folder")
        return
    start = time.perf_counter()
    request = FitRequest(capture, run, segments=out / "segments.npz", resume=True, prior=variant.prior)
    feedback = Feedback(lambda sentence: print(f"{name}: {sentence}", flush=True), track)
    state = run_fit(request, variant.config, CPU, feedback)
    seconds = time.perf_counter() - start
    contents = open_run(run, CPU)
    result = evaluate_run(contents, CPU)
    view = result.views[min(SHOWN, len(result.views) - 1)].view
    pictures = {"rendered": view.rendered, "photograph": view.photograph, "strands": drawn_strands(contents)}
    for file, image in pictures.items():
        write_png(run / f"{file}.png", image)
    figures = {"described": described, "steps": state.step, "seconds": seconds, **result.as_dict()}
    with atomic_file(finished) as temporary:
        temporary.write_text(json.dumps(figures))


def shown_view(contents: RunContents) -> int:
    """Index of the view that the pictures show."""
    return contents.shown[min(SHOWN, len(contents.shown) - 1)]


def drawn_strands(contents: RunContents) -> torch.Tensor:
    """The strands by direction, from the shown view."""
    points, camera = contents.renderer.strands.points, contents.capture.cameras[shown_view(contents)]
    return lines_picture(points, camera, contents.head.mesh)


def table(results: dict[str, dict]) -> str:
    """One line per variant."""
    wide = max(len(name) for name in results)
    names = list(next(iter(results.values()))["strands"])
    lines = ["precision / recall / F, strand consistency (percent, unsigned); hair region of held-out views; minutes"]
    heads = "".join(f"{name:>28}" for name in names[:3])
    lines.append(f"{'':{wide}}{heads}  inside %   PSNR   SSIM  LPIPS   min")
    for name, row in results.items():
        cells = ""
        for scores in list(row["strands"].values())[:3]:
            three = " / ".join(f"{scores[key]:.1f}" for key in ("precision", "recall", "f_score"))
            cells += f"{three}, {scores['strand_consistency']:.1f}".rjust(28)
        views = row["held_out_views"]
        lpips = "absent" if views["lpips"] is None else f"{views['lpips']:.4f}"
        lines.append(
            f"{name:{wide}}{cells}{row['inside_head_percent']:10.2f}{views['psnr']:7.2f}{views['ssim']:7.3f} {lpips:>6}"
            f"{row['seconds'] / 60:6.1f}"
        )
    return "\n".join(lines) + "\n"


def hair_part(capture: Capture, index: int) -> tuple[slice, slice]:
    """Rows and columns of a square around the hair of a view."""
    mask = capture.hair_mask(index)
    if mask is None:
        return slice(None), slice(None)
    row, column = torch.nonzero(mask > 0.5).T
    side = int((1 + MARGIN) * max(int(row.max() - row.min()), int(column.max() - column.min())))
    top = max(0, int(row.max() + row.min() - side) // 2)
    left = max(0, int(column.max() + column.min() - side) // 2)
    return slice(top, top + side), slice(left, left + side)


def contact_sheet(names: list[str], capture: Capture, out: Path) -> None:
    """OUT/ablations.png: the photograph and the true strands, then each variant's rendering and strands."""
    contents = open_run(out / folder_name(names[0]), CPU)
    camera = capture.cameras[shown_view(contents)]
    truth = capture.ground_truth
    true_strands = None if truth is None else lines_picture(truth.points, camera, contents.head.mesh)
    part = hair_part(capture, shown_view(contents))
    across = len(names) // 2 + 1
    figure = Figure(figsize=(3.2 * across, 13.2), dpi=DPI, layout="constrained")
    axes = figure.subplots(4, across, squeeze=False)
    for panel in axes.flat:
        panel.set_axis_off()
    axes[0, 0].set_title("photograph; truth", fontsize=9)
    axes[0, 0].imshow(capture.image(shown_view(contents))[part])
    if true_strands is not None:
        axes[1, 0].imshow(true_strands[part])
    for place, name in enumerate(names, start=1):
        row, column = 2 * (place // across), place % across
        axes[row, column].set_title(name, fontsize=9)
        for offset, file in enumerate(("rendered", "strands")):
            axes[row + offset, column].imshow(imread(out / folder_name(name) / f"{file}.png")[part])
    write_png(out / "ablations.png", figure_image(figure))


def write_results(names: list[str], capture: Capture, out: Path) -> None:
    """The tables and the contact sheet of every variant that is finished."""
    results = {}
    for name in names:
        finished = out / folder_name(name) / "figures.json"
        if finished.is_file():
            results[name] = json.loads(finished.read_text())
    write_json(out / "table.json", results)
    with atomic_file(out / "table.txt") as temporary:
        temporary.write_text(table(results))
    contact_sheet(list(results), capture, out)


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    only: tuple[str, ...] = ()
    """Names of variants; all by default."""
    steps: int = 300
    """Optimisation steps of each."""
    crop: int = 128
    """Side of a step's image region, pixels."""
    preset: Preset = "fast"
    """Settings that the variants change."""
    seed: int = 0
    """Seed of all random numbers."""
    positions_prior: Path | None = None
    """Weights of a prior that outputs positions."""


def main(arguments: Arguments) -> None:
    base = replace(preset(arguments.preset), steps=arguments.steps, crop=arguments.crop, seed=arguments.seed)
    chosen = variants(base, arguments.positions_prior)
    if unknown := set(arguments.only) - set(chosen):
        raise SystemExit(
            f"no such variant: {', '.join(sorted(unknown))}; there are {', '.join(chosen)}, "
            "positions only with --positions-prior"
        )
    capture = Capture.load(arguments.capture)
    shared_segments(capture, arguments.out, base)
    for name, variant in chosen.items():
        if arguments.only and name not in arguments.only:
            continue
        run_variant(name, variant, arguments.capture, arguments.out)
        write_results(list(chosen), capture, arguments.out)
    print((arguments.out / "table.txt").read_text(), end="")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
