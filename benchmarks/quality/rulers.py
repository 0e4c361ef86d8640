"""Upper bounds of the scores on a capture, and how much they reward blur.

    python benchmarks/quality/rulers.py --captures ../shared/data/captures/sintel_bob

Geometry: one half of the true strands against the other half. They are the same hair, yet they differ where a match
asks for a strand nearby: no fit of as many strands should expect more. The same for the points of the first half that
lie outside the head, because some grooms run through neck and shoulders, where no fit may put strands. Directions: the
true strands, drawn, against the streaks of held-out photographs, whose noise bounds the agreement. Pictures: held-out
photographs, blurred, against themselves, over the hair. Prints one JSON object per capture.
"""

import json
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
import tyro

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, held_out_views
from neural_strands.evaluation.geometry_metrics import score_geometry
from neural_strands.evaluation.lpips import find_lpips
from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.evaluation.strands_in_view import mean_strands_in_view, strands_in_view
from neural_strands.evaluation.view_quality import RenderedView, mean_quality, view_qualities
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import Strands
from neural_strands.model.compositing import area_mean
from neural_strands.raster.gaussian_blur import gaussian_blur
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles

SUPERSAMPLE = 3
"""Line pixels for each pixel of a photograph, along each axis; as in fits."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    captures: tuple[Path, ...] = (
        Path("../shared/data/captures/sintel_bob"),
        Path("../shared/data/captures/straight_long"),
    )
    """Captures with hair masks; those without true strands have no ruler for geometry."""
    width: float = 2.3e-4
    """Width of the drawn true strands, metres."""
    blurs: tuple[float, ...] = (1.0, 2.0, 4.0)
    """Standard deviations of the blur, pixels."""
    seed: int = 0
    """Seed of the division into halves."""


def halves(truth: Strands, head: Mesh, seed: int) -> dict[str, Any]:
    """One half of the strands against the other, and the same for those of its points that lie outside the head.

    Returns:
        F and strand consistency of the half; the share of its points inside the head; F and recall of the rest. All
        are percentages, the scores by name of the threshold.
    """
    order = torch.randperm(len(truth), generator=torch.Generator().manual_seed(seed))
    one, other = (sample_strands(truth.points[part]) for part in order.tensor_split(2))
    outside = SignedDistanceIndex(head)(one.points).distance >= 0
    whole = score_geometry(one, other)
    rest = score_geometry(one.selected(outside), other, with_consistency=False)
    return {
        "half_against_half": {score.threshold.name: round(score.unsigned.f_score, 2) for score in whole},
        "strand_consistency": {score.threshold.name: score.strand_consistency for score in whole},
        "inside_head": round(100 * (1 - float(outside.double().mean())), 2),
        "outside_against_half": {score.threshold.name: round(score.unsigned.f_score, 2) for score in rest},
        "outside_recall": {score.threshold.name: round(score.unsigned.recall, 2) for score in rest},
    }


def true_directions(capture: Capture, truth: Strands, head: Mesh, width: float) -> float | None:
    """Share of the streaks of held-out photographs that the true strands follow, percent."""
    views = capture.views_on()
    found = []
    for index in held_out_views(len(capture), HOLD_OUT_EVERY):
        view = views[index]
        fine = view.camera.resized(SUPERSAMPLE * view.camera.width, SUPERSAMPLE * view.camera.height)
        body = rasterise_triangles(head.vertices, head.faces, fine)
        lines = rasterise_lines(truth.points, fine, body.depth, LineConfig(width=width))
        alpha = area_mean((lines.segment >= 0).float()[..., None], SUPERSAMPLE)[..., 0]
        found.append(strands_in_view(lines, truth.points, alpha, view))
    return mean_strands_in_view(found).direction


def blurred(capture: Capture, sigma: float) -> dict[str, float | None]:
    """Scores over the hair of held-out photographs, blurred, against themselves."""
    views = capture.views_on()
    pairs = []
    for index in held_out_views(len(capture), HOLD_OUT_EVERY):
        view = views[index]
        soft = gaussian_blur(view.image.permute(2, 0, 1), sigma).permute(1, 2, 0)
        pairs.append(RenderedView(view.camera.name, soft, view.image, view.hair_mask))
    hair = mean_quality(view_qualities(pairs, find_lpips("squeeze", fetch=False)[0])).hair
    if hair is None:
        sys.exit(f"{capture.folder}: expected hair masks, found none; choose a capture with masks.")
    return {name: None if value is None else round(value, 4) for name, value in asdict(hair).items()}


def main(arguments: Arguments) -> None:
    """Print the rulers."""
    for folder in arguments.captures:
        capture = Capture.load(folder)
        truth = capture.ground_truth
        figures: dict[str, Any] = {"capture": folder.name, "strands": None if truth is None else len(truth)}
        if truth is not None:
            head = find_head(capture).mesh
            figures |= halves(truth, head, arguments.seed)
            figures["true_strands_direction"] = true_directions(capture, truth, head, arguments.width)
        figures["blurred"] = {f"{sigma:g} px": blurred(capture, sigma) for sigma in arguments.blurs}
        sys.stdout.write(json.dumps(figures) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(Arguments))
