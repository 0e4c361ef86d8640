"""The effect of each part of the fit: variants with one change, on one capture, side by side.

    python benchmarks/quality/ablations.py CAPTURE OUT [--only NAME ...] [--steps 300] [--seeds 3]
        [--positions-prior FILE]

All variants of a seed share line segments (made once, kept in OUT/seed_N) and number of steps. A variant that is
finished in OUT is not run again, one that was stopped goes on from its checkpoint. Writes OUT/table.md (means over the
seeds, ± half of their range), OUT/table.json and OUT/ablations.png: the strands of each variant and its rendering of a
held-out view, beside the photograph, for the first seed.

Shape: "full"; "no LMVS" (strands start from hair that hangs within the masks, and no loss compares them with segments);
"no coarse-to-fine, no root-to-tip"; "geometry alone" (images train the appearance, not the strands); "geometry alone,
no streaks" (nor do the photographs' streaks turn them); "positions" (a generator whose output is positions, not
gradients: FILE is what `neural-strands train-prior FILE --config.generator.synthesiser.output position` wrote). Images:
"random networks" (a start without what the shipped ones have learned); "strided UNet", which starts from random
weights, too; "no UNet" (splatted colours and their coverage are the picture); "no alpha loss". These begin from strands
traced through the segments, which leaves little to the order in which shape is freed; so the paper's start, its mean
strand at every root, is run with its coarse-to-fine and root-to-tip schedule and without.
"""

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import table_rows as rows
import torch
import tyro
from ablation_variants import Variant, full_config, variants
from hanging_hair import hanging_segments
from matplotlib.figure import Figure
from matplotlib.image import imread

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import training_views
from neural_strands.fitting.config import FitConfig, Preset
from neural_strands.fitting.first_model import fit_prior
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


def shared_segments(capture: Capture, out: Path, config: FitConfig, stereo: bool = True) -> Path:
    """Load or make the line segments of the training views: by stereo, or those of hair that hangs."""
    path = out / ("segments.npz" if stereo else "hanging.npz")
    if not path.is_file():
        seen, head = capture.subset(training_views(len(capture), config.hold_out_every)), find_head(capture, None)
        if stereo:
            segments = find_segments(seen, head, config, out / "lmvs", track)
        else:
            segments = hanging_segments(seen.views_on(), head, config)
        save_segments(path, segments, segments_source(seen, config))
    return path


def folder_name(name: str) -> str:
    """Folder name of a variant."""
    return "_".join("".join(letter if letter.isalnum() else " " for letter in name).split())


def run_variant(name: str, variant: Variant, capture: Capture, out: Path) -> None:
    """Fit, evaluate and draw one variant, unless it is finished; NAME/figures.json in `out` is written last."""
    run = out / folder_name(name)
    finished = run / "figures.json"
    described = json.loads(
        json.dumps(
            {
                **asdict(variant.config),
                "prior": weights_digest(fit_prior(variant.prior, CPU)),
                "segments of stereo": variant.stereo,
            }
        )
    )
    if finished.is_file():
        if json.loads(finished.read_text())["described"] != described:
            raise SystemExit(f"{run}: was made with other settings; delete it, or choose another folder")
        return
    segments = shared_segments(capture, out, variant.config, variant.stereo)
    start = time.perf_counter()
    request = FitRequest(capture.folder, run, segments=segments, resume=True, prior=variant.prior)
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


def contact_sheet(names: list[str], capture: Capture, out: Path) -> torch.Tensor:
    """The photograph and the true strands, then the rendering and strands of each variant in `out`."""
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
    return figure_image(figure)


def write_results(names: list[str], capture: Capture, out: Path, seeds: range) -> None:
    """The tables, and the contact sheet of the first seed, of every variant that is finished."""
    results: dict[str, list[dict[str, Any]]] = {}
    for name in names:
        finished = [seed_folder(out, seed) / folder_name(name) / "figures.json" for seed in seeds]
        if found := [json.loads(path.read_text()) for path in finished if path.is_file()]:
            results[name] = found
    write_json(out / "table.json", results)
    with atomic_file(out / "table.md") as temporary:
        temporary.write_text(rows.ablations(results) + "\n", encoding="utf-8")
    first = seed_folder(out, seeds[0])
    drawn = [name for name in results if (first / folder_name(name) / "figures.json").is_file()]
    write_png(out / "ablations.png", contact_sheet(drawn, capture, first))


def seed_folder(out: Path, seed: int) -> Path:
    """Folder of what was made with a seed."""
    return out / f"seed_{seed}"


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
    crop: int | None = None
    """Side of a step's image region, pixels; by default the preset's if all of its steps are taken, else at most
    128."""
    preset: Preset = "fast"
    """Settings that the variants change."""
    seeds: int = 1
    """How many seeds each variant is repeated with."""
    seed: int = 0
    """First of them."""
    positions_prior: Path | None = None
    """Weights of a prior that outputs positions."""


def main(arguments: Arguments) -> None:
    """Run the variants, seed by seed."""
    capture, seeds = Capture.load(arguments.capture), range(arguments.seed, arguments.seed + arguments.seeds)
    masked = any(capture.views_on().has_hair_mask)
    chosen: dict[str, Variant] = {}
    for seed in seeds:
        base = full_config(arguments.preset, arguments.steps, arguments.crop, seed)
        every = variants(base, arguments.positions_prior)
        chosen = {name: variant for name, variant in every.items() if variant.stereo or masked}
        if unknown := set(arguments.only) - set(chosen):
            raise SystemExit(
                f"no such variant: {', '.join(sorted(unknown))}; there are {', '.join(chosen)}, "
                "positions only with --positions-prior, no LMVS only with hair masks"
            )
        for name, variant in chosen.items():
            if arguments.only and name not in arguments.only:
                continue
            run_variant(name, variant, capture, seed_folder(arguments.out, seed))
            write_results(list(chosen), capture, arguments.out, seeds)
    print((arguments.out / "table.md").read_text(encoding="utf-8"), end="")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
