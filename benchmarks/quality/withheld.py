"""Withholds head and masks of a capture: how well `prepare` recovers them, and what initial strands lose by it.

    neural-strands prepare CAPTURE/images PREPARED --cameras CAPTURE/transforms.json --detector PYTHON
    python benchmarks/quality/withheld.py CAPTURE PREPARED [--strands 10000] [--work FOLDER] [--pictures FILE]

Prints one JSON object: scale against the true one; distance of the true scalp's faces from the head that was found and
the other way round, mm; intersection over union of the masks with the true ones where these exceed one half, and with
the same after gaps of less than five pixels between strands are closed, which no mask of a region can follow. With
`--work` also F at 1 mm/10°, 2 mm/20° and 3 mm/30° of first strands from the true input and from what was found, at
equal numbers of strands; segments are found anew for both and kept in that folder.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
import tyro
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, training_views
from neural_strands.evaluation.geometry_metrics import THRESHOLDS, score_geometry
from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.fitting.config import FitConfig, preset
from neural_strands.fitting.first_strands import hair_roots, trace_first_strands
from neural_strands.fitting.fit_data import head_distance_grid
from neural_strands.fitting.stereo import find_segments
from neural_strands.foundation.progress import track
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.lmvs.files import load_segments, save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.scalp.head import Head

STRICT = THRESHOLDS[:3]
GAP = 5
"""Width of gaps between strands that a mask of a region closes, pixels."""
SHOWN = 8
"""Views in the picture."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Annotated[Path, tyro.conf.Positional]
    """A capture with head, hair masks and true strands."""
    prepared: Annotated[Path, tyro.conf.Positional]
    """What `prepare` made of its pictures and cameras."""
    strands: int = 10_000
    """Number of initial strands to trace."""
    work: Path | None = None
    """Folder for segments; without it, no strands are traced."""
    pictures: Path | None = None
    """Where to draw masks: what was missed in red, what is too much in blue."""


def scalp_distances(found: Mesh, scalp: Mesh, true: Head) -> dict[str, float]:
    """Between the middles of the scalps' faces and the other head's surface, mm."""
    ways = {
        "true_to_found": closest_points(true.scalp_mesh.corners().mean(dim=1), found).distance,
        "found_to_true": closest_points(scalp.corners().mean(dim=1), true.mesh).distance,
    }
    return {
        f"scalp_{way}_{name}_mm": 1e3 * float(value)
        for way, distance in ways.items()
        for name, value in (("mean", distance.mean()), ("p90", distance.quantile(0.9)))
    }


def overlap(found: Bool[np.ndarray, "row column"], true: Bool[np.ndarray, "row column"]) -> float:
    """Intersection over union."""
    return float((found & true).sum() / max((found | true).sum(), 1))


def mask_figures(capture: Capture, prepared: Capture, picture: Path | None) -> dict[str, float]:
    """Means over all views."""
    numbers = {camera.name: index for index, camera in enumerate(prepared.cameras)}
    square = np.ones((GAP, GAP), np.uint8)
    rows: list[tuple[float, ...]] = []
    drawn: list[np.ndarray] = []
    every = max(1, len(capture) // SHOWN)
    for index, camera in enumerate(capture.cameras):
        true, found = capture.hair_mask(index), prepared.hair_mask(numbers[camera.name])
        assert true is not None
        assert found is not None
        hair, ours = true.numpy() > 0.5, found.numpy() > 0.5
        closed = cv2.morphologyEx(hair.astype(np.uint8), cv2.MORPH_CLOSE, square) > 0
        hit = (hair & ours).sum()
        rows.append(
            (overlap(ours, hair), overlap(ours, closed), overlap(closed, hair), hit / ours.sum(), hit / hair.sum())
        )
        if index % every == 0:
            shade = 0.5 * capture.image(index).numpy()
            shade += 0.5 * np.stack([hair & ~ours, np.zeros_like(hair), ours & ~hair], axis=-1)
            drawn.append(shade)
    if picture is not None:
        write_png(picture, torch.from_numpy(np.concatenate(drawn[:SHOWN], axis=1)).clamp(0, 1).float())
    names = ("mask_iou", "mask_iou_closed", "true_mask_iou_closed", "mask_precision", "mask_recall")
    return {name: float(value) for name, value in zip(names, np.mean(rows, axis=0), strict=True)}


def first_strands(capture: Capture, head: Head, count: int, config: FitConfig, file: Path) -> Float[Tensor, "s p 3"]:
    """Traced from the training views, in the capture's world."""
    kept = capture.subset(training_views(len(capture), HOLD_OUT_EVERY))
    if not file.is_file():
        save_segments(file, find_segments(kept, head, config, file.with_suffix(""), track))
    views, random = kept.views_on(), torch.Generator().manual_seed(config.seed)
    roots = hair_roots(head, count, views, config.initial.hull, random)
    distance = head_distance_grid(head.mesh)
    found = trace_first_strands(head, load_segments(file), views, roots, config.initial, distance, random)
    return found.strands.points


def main(arguments: Arguments) -> None:
    """Compare."""
    capture, prepared = Capture.load(arguments.capture), Capture.load(arguments.prepared)
    truth = capture.ground_truth
    if truth is None:
        raise SystemExit(f"{arguments.capture}: expected a capture with true strands, found none.")
    true_head, head = find_head(capture), find_head(prepared)
    frame = FittedHead.load(arguments.prepared / "preparation" / "head").frame

    def back(points: Tensor) -> Tensor:
        return frame.inverse().apply(points.double()).float()

    found = Mesh(back(head.mesh.vertices), head.mesh.faces)
    result: dict[str, object] = {"capture": arguments.capture.name, "scale": float(frame.scale)}
    result |= scalp_distances(found, Mesh(found.vertices, found.faces[head.scalp_faces]), true_head)
    result |= mask_figures(capture, prepared, arguments.pictures)
    if arguments.work is not None:
        config, true = preset("fast"), sample_strands(truth.points)
        arguments.work.mkdir(parents=True, exist_ok=True)
        result["strands"] = arguments.strands
        for name, source, its_head in (("true", capture, true_head), ("found", prepared, head)):
            file = arguments.work / f"{arguments.capture.name}_{name}.npz"
            points = first_strands(source, its_head, arguments.strands, config, file)
            ours = sample_strands(points if source is capture else back(points))
            scores = score_geometry(ours, true, STRICT, with_consistency=False)
            result[f"f_from_{name}_input"] = [round(each.unsigned.f_score, 2) for each in scores]
    sys.stdout.write(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
