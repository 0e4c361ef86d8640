"""Initial strands of a synthetic capture from its frontal views only, compared with the true hair that no view sees.

    python benchmarks/quality/unseen.py CAPTURE [--front 90] [--segments FILE] [--picture FILE]

Views within `--front` degrees of the face are kept, the rest is not even read. Precision, recall and F at 5 mm and 40
degrees are of the points that the kept views do not see; the seen ones are reported beside them. A strand is too long
beyond 1.3 times the longest one seen, and off the head if it leaves it further than the thickest hair seen. Prints one
JSON object; the picture shows true (left) and found strands (right) from behind and from the side.
"""

import json
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.evaluation.geometry_metrics import Agreement, Threshold, matched_shares
from neural_strands.evaluation.oriented_points import OrientedPoints, sample_strands
from neural_strands.fitting.config import preset
from neural_strands.fitting.first_strands import hair_roots, trace_first_strands
from neural_strands.fitting.fit_data import head_distance_grid
from neural_strands.fitting.stereo import find_segments
from neural_strands.flow.tracing import TracedStrands
from neural_strands.flow.unseen import unseen_points
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import lengths
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.lmvs.files import load_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.pictures.lines import lines_picture

MATCH = Threshold(0.005, math.radians(40))
STEP = 0.002
"""Distance between compared points, metres."""
SAME = 0.01
"""Distance by which unseen hair may be thicker than the thickest seen hair, metres."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Annotated[Path, tyro.conf.Positional]
    """A capture with true strands."""
    front: float = 90.0
    """Largest azimuth of a view that is kept, degrees to either side of the face."""
    segments: Path | None = None
    """Segments of the kept views; without them stereo finds some, with the settings of a fit."""
    strands: int = 10_000
    """Strands to trace."""
    picture: Path | None = None
    """Where to draw true and found strands."""


def frontal(capture: Capture, degrees: float, middle: torch.Tensor) -> Capture:
    """The views whose azimuth about `middle` is at most so many degrees from +z."""
    places = [camera.position - middle for camera in capture.cameras]
    azimuth = [math.degrees(abs(math.atan2(float(place[0]), float(place[2])))) for place in places]
    return capture.subset([index for index, angle in enumerate(azimuth) if angle <= degrees])


def agreement(ours: OrientedPoints, truth: OrientedPoints, hidden: tuple[torch.Tensor, torch.Tensor]) -> Agreement:
    """Precision of our points and recall of the true ones, each where `hidden` holds."""
    chosen = [points.selected(keep) for points, keep in zip((ours, truth), hidden, strict=True)]
    precision, recall = (
        matched_shares(part, others, [MATCH])[0][0] for part, others in zip(chosen, (truth, ours), strict=True)
    )
    return Agreement(precision, recall)


def figures(found: TracedStrands, truth: torch.Tensor, views: list[HeadView], head: Mesh) -> dict[str, float]:
    """All printed figures of strands."""
    skin = SignedDistanceIndex(head)

    def judged(points: torch.Tensor) -> tuple[OrientedPoints, torch.Tensor, torch.Tensor]:
        sampled = sample_strands(points, STEP)
        near = skin(sampled.points)
        return sampled, unseen_points(sampled.points, near.distance, near.normal, views), near.distance

    ours, our_hidden, our_distance = judged(found.points)
    true, true_hidden, _ = judged(truth)
    behind = agreement(ours, true, (our_hidden, true_hidden))
    front = agreement(ours, true, (~our_hidden, ~true_hidden))
    length, guessed = lengths(found.points), found.unseen > 0
    longest, thickest = length[~guessed].max(), our_distance[~guessed[ours.curve]].max()
    off = torch.zeros_like(guessed).index_fill(0, ours.curve[our_distance > thickest + SAME], True) & guessed
    return {
        "unseen_points_percent": 100 * float(our_hidden.float().mean()),
        "true_unseen_points_percent": 100 * float(true_hidden.float().mean()),
        "unseen_strands": int(guessed.sum()),
        **{f"unseen_{name}": value for name, value in behind.as_dict().items()},
        **{f"seen_{name}": value for name, value in front.as_dict().items()},
        "longest_seen_mm": 1e3 * float(longest),
        "longest_unseen_mm": 1e3 * float(length[guessed].max()) if bool(guessed.any()) else 0.0,
        "too_long": int((length[guessed] > 1.3 * longest).sum()),
        "thickest_seen_mm": 1e3 * float(thickest),
        "off_the_head": int(off.sum()),
    }


def picture(strands: list[torch.Tensor], head: Mesh) -> torch.Tensor:
    """True and found strands beside each other, from behind and, below, from the side."""
    middle = head.vertices.mean(dim=0)
    rows = []
    for offset in ([0.0, 0.1, -0.9], [0.85, 0.1, -0.3]):
        camera = Camera.look_at(middle + torch.tensor(offset), middle, 900.0, (512, 512))
        rows.append(torch.cat([lines_picture(points[::2], camera, head) for points in strands], dim=1))
    return torch.cat(rows)


def main(arguments: Arguments) -> None:
    """Trace and compare."""
    capture = Capture.load(arguments.capture)
    truth = capture.ground_truth
    if truth is None:
        raise SystemExit(f"{arguments.capture}: expected a capture with true strands, found none.")
    head, config = find_head(capture, None), preset("fast")
    kept = frontal(capture, arguments.front, head.mesh.vertices.mean(dim=0))
    if arguments.segments is not None:
        segments = load_segments(arguments.segments)
    else:
        work = arguments.capture.parent / f"{arguments.capture.name}_front"
        segments = find_segments(kept, head, config, work, track)
    views = kept.views_on()
    random = torch.Generator().manual_seed(0)
    roots = hair_roots(head, arguments.strands, views, config.initial.hull, random)
    distance = head_distance_grid(head.mesh)
    found = trace_first_strands(head, segments, views, roots, config.initial, distance, random).strands
    index = MeshIndex(head.mesh)
    before = [HeadView.of(camera, index) for camera in views.cameras]
    result = figures(found, truth.points, before, head.mesh)
    sys.stdout.write(json.dumps({"capture": arguments.capture.name, "views": len(kept)} | result) + "\n")
    if arguments.picture is not None:
        write_png(arguments.picture, picture([truth.points, found.points], head.mesh))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
