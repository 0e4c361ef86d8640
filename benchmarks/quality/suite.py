"""Scores initial strands on a suite of synthetic captures, half of which are never used for tuning.

    python benchmarks/quality/suite.py build ROOT [--data ../shared/data] [--only NAME ...]
    python benchmarks/quality/suite.py score ROOT [--only NAME ...] [--label NAME] [--seeds 3]

`build` renders the captures (see suite_cases.py) into ROOT/captures and goes on where it was stopped. `score` finds
line segments in the training views, traces first strands and compares them with the true ones: F at 1 mm/10°, 2 mm/20°
and 3 mm/30°, strand consistency, lengths against the true ones (median and 95th percentile), points inside the head,
always beside the number of strands. It writes ROOT/LABEL.json and .txt (all seeds; means over the test half, worst case
by name) and ROOT/LABEL/NAME.png: true strands above the found ones, coloured by direction, from the front, the side and
behind. `--runs FOLDER` scores fits instead, with their own segments: those in FOLDER/NAME (`neural-strands fit
ROOT/captures/NAME FOLDER/NAME`).
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import torch
import tyro
from suite_cases import CASES, Case, build

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, training_views
from neural_strands.evaluation.geometry_metrics import THRESHOLDS, fit_to_head, score_geometry
from neural_strands.evaluation.oriented_points import sample_segments, sample_strands
from neural_strands.fitting.config import preset
from neural_strands.fitting.first_strands import hair_roots, trace_first_strands
from neural_strands.fitting.fit_data import head_distance_grid
from neural_strands.fitting.stereo import find_segments
from neural_strands.foundation.files import write_json
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.strands import lengths
from neural_strands.grooms.io import read_groom
from neural_strands.lmvs.files import load_segments, save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.pictures.lines import lines_picture
from neural_strands.runs.run_folder import RunFolder
from neural_strands.scalp.head import Head

STRICT = THRESHOLDS[:3]
"""Reported thresholds."""
ROOTED = 0.004
"""Largest distance to a true root within which true hair grows, metres: a head's scalp may be larger than its
groom's."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    what: Annotated[Literal["build", "score"], tyro.conf.Positional]
    """Render the captures, or score strands on those that are rendered."""
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
    reuse: bool = False
    """Reuse segments of an earlier score, although the code may have changed since."""
    runs: Path | None = None
    """Folder of fits to score instead of initial strands."""


@dataclass(frozen=True)
class Row:
    """Figures of one case and seed."""

    case: str
    half: str
    seed: int
    strands: int
    f_scores: list[float]
    """Percent, at each threshold."""
    segment_scores: list[list[float]]
    """Precision and recall of the line segments, percent, at each threshold."""
    consistency: float
    """Percent at 2 mm."""
    length_ratios: list[float]
    """Found to true: median and 95th percentile, of strands that grow where true ones do."""
    inside: float
    """Percent of points inside the head."""


@dataclass
class Table:
    """Rows as text, the first with the heads."""

    rows: list[list[str]]

    def add(self, case: str, half: str, seed: str, members: Sequence[Row]) -> None:
        """Append the mean of these rows."""

        def mean(values: list[list[float]], form: str) -> str:
            return slashed(torch.tensor(values).mean(dim=0).tolist(), form)

        self.rows.append(
            [
                case,
                half,
                seed,
                str(round(sum(row.strands for row in members) / len(members))),
                mean([row.f_scores for row in members], "{:.1f}"),
                mean([[row.consistency] for row in members], "{:.1f}"),
                mean([row.length_ratios for row in members], "{:.2f}"),
                mean([[row.inside] for row in members], "{:.2f}"),
                mean([row.segment_scores[1] for row in members], "{:.1f}"),
            ]
        )

    def text(self) -> str:
        """Columns aligned to the right, the first to the left."""
        widths = [max(len(row[k]) for row in self.rows) for k in range(len(self.rows[0]))]
        lines = (
            "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
            for row in self.rows
        )
        return "\n".join(lines) + "\n"


def score(case: Case, arguments: Arguments, seed: int) -> Row:
    """Trace strands of one case, or read fitted ones, and compare them with the true ones."""
    capture = Capture.load(arguments.root / "captures" / case.name)
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
        points = trace_first_strands(head, segments, views, roots, config.initial, head_distance_grid(head.mesh)).points
    true, ours = sample_strands(truth.points), sample_strands(points)
    scores = score_geometry(ours, true, STRICT)
    stereo = score_geometry(sample_segments(segments), true, STRICT, with_consistency=False)
    inside = fit_to_head(ours, head.mesh)
    assert inside is not None
    assert scores[1].strand_consistency is not None
    write_png(arguments.root / arguments.label / f"{case.name}.png", picture([truth.points, points], head.mesh))
    beside, _ = nearest(points[:, 0], truth.points[:, 0], radius=ROOTED)
    ours_long, true_long = lengths(points[beside.isfinite()]), lengths(truth.points)
    return Row(
        case.name,
        case.half,
        seed,
        len(points),
        [each.unsigned.f_score for each in scores],
        [[each.unsigned.precision, each.unsigned.recall] for each in stereo],
        scores[1].strand_consistency,
        [float(ours_long.quantile(q) / true_long.quantile(q)) for q in (0.5, 0.95)],
        inside.inside,
    )


def picture(strands: Sequence[torch.Tensor], head: Mesh) -> torch.Tensor:
    """One row for each set of strands: from the front, the side and behind."""
    low, high = strands[0].amin(dim=(0, 1)), strands[0].amax(dim=(0, 1))
    middle, size = 0.5 * (low + high), float((high - low).max())
    rows = []
    for points in strands:
        views = []
        for away in ([0.0, 0.1, 1.0], [1.0, 0.1, 0.0], [0.0, 0.1, -1.0]):
            camera = Camera.look_at(middle + torch.tensor(away), middle, 420 / size, (480, 480))
            views.append(lines_picture(points[:: max(1, len(points) // 5000)], camera, head))
        rows.append(torch.cat(views, dim=1))
    return torch.cat(rows)


def table(rows: Sequence[Row]) -> str:
    """All rows, the means of each half, and the worst case of the test half at 2 mm."""
    found = Table([["case", "half", "seed", "strands", "F 1 / 2 / 3 mm", "consistency", "length", "inside", "stereo"]])
    for row in rows:
        found.add(row.case, row.half, str(row.seed), [row])
    for half in ("tuning", "test"):
        members = [row for row in rows if row.half == half]
        if members:
            found.add("mean", half, "all", members)
    tested = [row for row in rows if row.half == "test"]
    if tested:
        worst = min(tested, key=lambda row: row.f_scores[1])
        found.add(f"worst: {worst.case}", worst.half, str(worst.seed), [worst])
    spread = seed_spread(rows)
    return found.text() + (f"F's standard deviation over seeds, mean over cases: {spread}\n" if spread else "")


def seed_spread(rows: Sequence[Row]) -> str:
    """Standard deviation of F over the seeds of a case, mean over all cases; empty for single seeds."""
    groups = [[row.f_scores for row in rows if row.case == case] for case in dict.fromkeys(row.case for row in rows)]
    spreads = [torch.tensor(group).std(dim=0) for group in groups if len(group) > 1]
    return slashed(torch.stack(spreads).mean(dim=0).tolist(), "{:.2f}") if spreads else ""


def slashed(values: Sequence[float], form: str) -> str:
    """Numbers in one cell."""
    return " / ".join(form.format(value) for value in values)


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
    """Build or score the chosen cases."""
    unknown = set(arguments.only) - {case.name for case in CASES}
    if unknown:
        sys.exit(f"--only: expected names of {', '.join(case.name for case in CASES)}, found {', '.join(unknown)}.")
    if arguments.runs is not None and arguments.seeds != 1:
        sys.exit(f"--seeds: expected 1 with --runs, where each case has one fit, found {arguments.seeds}.")
    chosen = [case for case in CASES if not arguments.only or case.name in arguments.only]
    if arguments.what == "build":
        for case in chosen:
            rendered = build(case, arguments.data, arguments.root / "captures" / case.name)
            print(f"{case.name}: {rendered} of {case.views} views rendered now")
        return
    rows: list[Row] = []
    (arguments.root / arguments.label).mkdir(parents=True, exist_ok=True)
    for case in chosen:
        if not (arguments.root / "captures" / case.name / "transforms.json").is_file():
            print(f"{case.name}: not rendered yet, left out")
            continue
        if arguments.runs is not None and not RunFolder(arguments.runs / case.name).groom_arrays.is_file():
            print(f"{case.name}: not fitted yet, left out")
            continue
        rows += [score(case, arguments, seed) for seed in range(arguments.seeds)]
        write_json(arguments.root / f"{arguments.label}.json", {"rows": [asdict(row) for row in rows]})
    text = table(rows)
    (arguments.root / f"{arguments.label}.txt").write_text(text, encoding="utf-8")
    print(text, end="")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
