"""Scores initial strands on a suite of synthetic captures, half of which are never used for tuning.

    python benchmarks/quality/suite.py run ROOT [--data ../shared/data] [--only NAME ...] [--label NAME] [--seeds 3]

`run` renders the captures (see suite_cases.py) into ROOT/captures, case by case, and scores each; `build` only renders,
`score` only scores what is rendered. All go on where they were stopped. To score a case is to find line segments in its
training views, trace first strands and compare them with the true ones: F at 1 mm/10°, 2 mm/20° and 3 mm/30°, strand
consistency, lengths against the true ones (median and 95th percentile), points inside the head, always beside the
number of strands.

Each case and seed has a row, ROOT/LABEL/NAME_SEED.json, and a picture beside it (see suite_pictures.py). A row that is
there is not scored again, even if the code has changed: that takes --again or another label. ROOT/LABEL.json and .txt
are made from all rows that are there: every seed, means over the cases of each half, and the worst case of the test
half.

`--runs FOLDER` scores fits instead, with their own segments: those in FOLDER/NAME (`neural-strands fit
ROOT/captures/NAME FOLDER/NAME`).
"""

import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from suite_cases import CASES, Case, build
from suite_pictures import sheet
from suite_table import Row, row_path, write_results

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, training_views
from neural_strands.evaluation.geometry_metrics import THRESHOLDS, fit_to_head, score_geometry
from neural_strands.evaluation.oriented_points import sample_segments, sample_strands
from neural_strands.evaluation.strand_lengths import compare_lengths
from neural_strands.fitting.config import preset
from neural_strands.fitting.first_strands import hair_roots, trace_first_strands
from neural_strands.fitting.fit_data import head_distance_grid
from neural_strands.fitting.stereo import find_segments
from neural_strands.foundation.files import write_json
from neural_strands.foundation.progress import track
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.grooms.io import read_groom
from neural_strands.lmvs.files import load_segments, save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.runs.run_folder import RunFolder
from neural_strands.scalp.head import Head

STRICT = THRESHOLDS[:3]
"""Reported thresholds."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    what: Annotated[Literal["run", "build", "score"], tyro.conf.Positional]
    """Render the captures and score strands on them; only render; or only score on those that are rendered."""
    root: Annotated[Path, tyro.conf.Positional]
    """Root folder of the suite."""
    data: Path = Path("../shared/data")
    """Folder of grooms, heads and captures."""
    only: tuple[str, ...] = ()
    """Names of cases; none: all."""
    label: str = "first_strands"
    """Name of the results."""
    strands: int = 10_000
    """Number of initial strands to trace."""
    seeds: int = 1
    """Number of seeds, of stereo and roots."""
    again: bool = False
    """Score rows again that are there."""
    reuse: bool = False
    """Reuse segments of an earlier score, although the code may have changed since."""
    runs: Path | None = None
    """Folder of fits to score instead of initial strands."""

    @property
    def captures(self) -> Path:
        """Folder of the rendered captures."""
        return self.root / "captures"

    @property
    def results(self) -> Path:
        """Folder of the rows of this label."""
        return self.root / self.label


def score(case: Case, arguments: Arguments, seed: int) -> Row:
    """Trace strands of one case, or read fitted ones, and compare them with the true ones."""
    capture = Capture.load(arguments.captures / case.name)
    head, config = find_head(capture), preset("fast")
    truth = capture.ground_truth
    assert truth is not None
    if arguments.runs is not None:
        run = RunFolder(arguments.runs / case.name)
        segments, points = load_segments(run.segments), read_groom(run.groom_arrays).strands().points
    else:
        segments = segments_of(capture, head, case, arguments, seed)
        kept = capture.subset(training_views(len(capture), HOLD_OUT_EVERY))
        views, random = kept.views_on(), torch.Generator().manual_seed(seed)
        roots = hair_roots(head, arguments.strands, views, config.initial.hull, random)
        distance = head_distance_grid(head.mesh)
        found = trace_first_strands(head, segments, views, roots, config.initial, distance, random)
        points = found.strands.points
    true, ours = sample_strands(truth.points), sample_strands(points)
    scores = score_geometry(ours, true, STRICT)
    stereo = score_geometry(sample_segments(segments), true, STRICT, with_consistency=False)
    inside = fit_to_head(ours, head.mesh)
    assert inside is not None
    assert scores[1].strand_consistency is not None
    write_png(arguments.results / f"{case.name}_{seed}.png", sheet(truth.points, points, head.mesh))
    lengths = compare_lengths(points, truth.points)
    assert lengths is not None
    return Row(
        case.name,
        case.half,
        seed,
        len(points),
        [each.unsigned.f_score for each in scores],
        [[each.unsigned.precision, each.unsigned.recall] for each in stereo],
        scores[1].strand_consistency,
        list(lengths.ratios),
        inside.inside,
    )


def segments_of(capture: Capture, head: Head, case: Case, arguments: Arguments, seed: int) -> LineSegments:
    """Line segments of the training views; the matching of views is kept and repeated only if its input changes."""
    path = arguments.root / "segments" / f"{case.name}_{seed}.npz"
    if arguments.reuse and path.is_file():
        return load_segments(path)
    kept = capture.subset(training_views(len(capture), HOLD_OUT_EVERY))
    config = replace(preset("fast"), seed=seed)
    segments = find_segments(kept, head, config, arguments.root / "lmvs" / f"{case.name}_{seed}", track)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_segments(path, segments)
    return segments


def main(arguments: Arguments) -> None:
    """Build the chosen cases, score them, or both."""
    unknown = set(arguments.only) - {case.name for case in CASES}
    if unknown:
        sys.exit(f"--only: expected names of {', '.join(case.name for case in CASES)}, found {', '.join(unknown)}.")
    if arguments.runs is not None and arguments.seeds != 1:
        sys.exit(f"--seeds: expected 1 with --runs, where each case has one fit, found {arguments.seeds}.")
    if arguments.what != "build":
        check_settings(arguments)
    for case in CASES:
        if arguments.only and case.name not in arguments.only:
            continue
        if arguments.what == "build":
            render(case, arguments)
            continue
        seeds = unscored(case, arguments)
        if seeds and arguments.what == "run":
            render(case, arguments)
        if seeds and (lack := missing(case, arguments)):
            print(f"{case.name}: {lack}, left out", flush=True)
            continue
        for seed in seeds:
            write_json(row_path(arguments.results, case.name, seed), asdict(score(case, arguments, seed)))
            write_results(arguments.results)
    if arguments.what != "build":
        print(write_results(arguments.results), end="")


def render(case: Case, arguments: Arguments) -> None:
    """Render the missing views of a case."""
    rendered = build(case, arguments.data, arguments.captures / case.name)
    print(f"{case.name}: {rendered} of {case.views} views rendered now", flush=True)


def unscored(case: Case, arguments: Arguments) -> list[int]:
    """The seeds of a case that are to be scored."""
    seeds = range(arguments.seeds)
    return [seed for seed in seeds if arguments.again or not row_path(arguments.results, case.name, seed).is_file()]


def missing(case: Case, arguments: Arguments) -> str:
    """What a case lacks to be scored, or nothing."""
    if not (arguments.captures / case.name / "transforms.json").is_file():
        return "not rendered yet"
    if arguments.runs is not None and not RunFolder(arguments.runs / case.name).groom_arrays.is_file():
        return "not fitted yet"
    return ""


def check_settings(arguments: Arguments) -> None:
    """Refuse to mix rows of different strands under one label."""
    runs = None if arguments.runs is None else str(arguments.runs.resolve())
    path, settings = arguments.results / "settings.json", {"strands": arguments.strands, "runs": runs}
    if not path.is_file():
        write_json(path, settings)
    if json.loads(path.read_text(encoding="utf-8")) != settings:
        sys.exit(f"{arguments.results}: has rows of other --strands or --runs (settings.json); choose another --label.")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
