"""`neural-strands score`: how well strands or line segments agree with true strands."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.cli.streams import print_json
from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    from neural_strands.evaluation.geometry_metrics import GeometryScore, HeadFit

COARSEST_STEP = 0.5
"""Millimetres: a coarser sampling would no longer resolve the 1 mm threshold."""


@dataclass(frozen=True)
class Score:
    """Score strands or unordered line segments against true strands: precision, recall and F in percent.

    Both are sampled along their length. A point matches when the other set has one within a distance whose direction
    deviates by no more than an angle: 1 mm and 10°, 2 mm and 20°, 3 mm and 30°, 4 mm and 40°. In dense hair a strand
    that strayed sideways still matches another one; there, the strand consistency (the largest share of a true strand's
    points that a single predicted strand matches) says more.
    """

    predicted: Annotated[Path, tyro.conf.Positional]
    """Groom or line segments, metres: .hair, .data, .tfx, .usd, .ply, .obj or .npz."""
    truth: Annotated[Path, tyro.conf.Positional]
    """True strands: a groom, ground_truth.npz of a capture, or the capture's folder."""
    head: Path | None = None
    """Head mesh (metres): also print the share of points inside it and the distance of roots from its scalp, which is
    read from scalp_faces.json beside it if there is one."""
    step: float = 0.5
    """Largest distance between samples along a strand, millimetres, at most 0.5."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object: under each threshold ("2mm/20deg") precision, recall, f_score, the same under "signed",
    and strand_consistency, all in percent."""

    def run(self) -> None:
        """Read, sample, compare, print."""
        from neural_strands.evaluation.geometry_metrics import fit_to_head, score_geometry
        from neural_strands.evaluation.score_files import read_oriented_points
        from neural_strands.scalp.head_file import read_metric_head

        if not 0 < self.step <= COARSEST_STEP:
            raise InputError(
                f"--step: expected more than 0 and at most {COARSEST_STEP} millimetres, found {self.step:g}."
            )
        device = pick_device(self.device)
        head = None if self.head is None else read_metric_head(self.head)
        predicted = read_oriented_points(self.predicted, 1e-3 * self.step).to(device)
        truth = read_oriented_points(self.truth, 1e-3 * self.step).to(device)
        scores = score_geometry(predicted, truth)
        fit = None
        if head is not None:
            scalp = None if head.scalp_faces is None else head.scalp_faces.to(device)
            fit = fit_to_head(predicted, head.mesh.to(device), scalp)
        if self.json:
            print_json(as_dict(scores, fit))
        else:
            count, true_count = len(predicted.roots()), len(truth.roots())
            sys.stdout.write(f"{count} predicted lines (strands or segments) with {len(predicted)} points, ")
            sys.stdout.write(f"{true_count} true strands with {len(truth)} points\n")
            sys.stdout.write(table(scores, count, fit))


def as_dict(scores: "tuple[GeometryScore, ...]", fit: "HeadFit | None") -> dict[str, Any]:
    """What `--json` prints."""
    result: dict[str, Any] = {score.threshold.name: score.as_dict() for score in scores}
    if fit is not None:
        result["head"] = {
            "inside_percent": fit.inside,
            "inside_2mm_percent": fit.clearly_inside,
            "root_distance_median_m": fit.root_median,
            "root_distance_95_m": fit.root_95,
            "root_distance_max_m": fit.root_largest,
        }
    return result


def table(scores: "tuple[GeometryScore, ...]", count: int, fit: "HeadFit | None") -> str:
    """The same for people, with the number of predicted lines beside F."""
    heads = ("threshold", "precision", "recall", "F", "lines", "consistency", "signed precision", "recall", "F")
    rows: list[tuple[str, ...]] = [heads]
    for score in scores:
        unsigned = [f"{figure:.2f}" for figure in score.unsigned.as_dict().values()]
        others = [f"{figure:.2f}" for figure in (score.strand_consistency or 0.0, *score.signed.as_dict().values())]
        rows.append((score.threshold.name, *unsigned, str(count), *others))
    widths = [max(len(row[k]) for row in rows) for k in range(len(heads))]
    text = "".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) + "\n" for row in rows)
    if fit is not None:
        text += (
            f"inside the head: {fit.inside:.2f} % of points, {fit.clearly_inside:.2f} % by more than 2 mm\n"
            f"roots from the scalp: {1e3 * fit.root_median:.2f} mm median, {1e3 * fit.root_95:.2f} mm at 95 %, "
            f"{1e3 * fit.root_largest:.2f} mm at most\n"
        )
    return text
