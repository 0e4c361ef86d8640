"""How much of an error in the strands images alone can correct.

    python benchmarks/quality/recovery.py --capture ../shared/data/captures/sintel_bob

True strands are displaced, similarly for neighbours, or shortened. The appearance is learned on the disturbed strands,
as in a fit, or with `--learned-on true` on the true ones, which shows the most that images can correct; then only the
rendering and alpha losses (and streaks, with `--streaks WEIGHT`) update the shape, without segments or any term that
holds strands in place.
Reported for points visible in photographs: the mean distance, across the strand, from the same point of the true
strand, before and after; for all strands: F at 1 and 2 mm and the share of the true length. Prints one JSON object per
case.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import torch
import tyro
from appearance import strand_segments
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import held_out_views
from neural_strands.evaluation.geometry_metrics import THRESHOLDS, Agreement, matched_shares
from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.evaluation.view_quality import image_quality
from neural_strands.fitting.config import FitConfig, FitWeights
from neural_strands.fitting.first_model import fit_prior
from neural_strands.fitting.first_strands import texture_from_latents
from neural_strands.fitting.fit import fit, start_fit
from neural_strands.fitting.fit_data import FitData, gather_fit_data
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.fitting.seen_points import seen_points
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.geometry.frames import to_local
from neural_strands.geometry.resample import resample
from neural_strands.geometry.strands import directions, lengths
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.renderer import HairRenderer
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.scalp.roots import attach_roots

LOCK = 0.02
"""Correlation length of the displacements, metres."""
WAVES = 64
"""Number of plane waves in a displacement."""
EVERY = 10
"""One strand in this many is matched."""

Points = Float[Tensor, "strand point 3"]


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Path = Path("../shared/data/captures/sintel_bob")
    """A capture with true strands and hair masks."""
    displaced: tuple[float, ...] = (0.0003, 0.0007, 0.0015)
    """Root mean square of the displacements, metres, one case each."""
    cut: tuple[float, ...] = (0.1,)
    """Shares of their length that strands lose, one case each."""
    learned_on: Literal["disturbed", "true"] = "disturbed"
    """Strands on which the appearance is learned."""
    appearance_steps: int = 600
    """Steps that teach the appearance."""
    shape_steps: int = 600
    """Steps that move the shape as well."""
    factor: float = 1.0
    """Factor on the image gradients that reach the shape texture; fits use 0.05."""
    rate: float = 1e-3
    """Adam's rate for the shape texture; fits use 4e-3."""
    streaks: float = 0.0
    """Weight of the comparison with the photographs' streaks; fits use 60."""
    crop: int = 160
    """Side of a region, pixels."""
    seed: int = 0
    """Seed of displacements, weights, views and regions."""


def displacement(points: Points, size: float, seed: int) -> Points:
    """A smooth random field at the points, `size` metres in the mean square, that grows from nothing over 2 cm."""
    random = torch.Generator().manual_seed(seed)
    waves = torch.randn(WAVES, 3, generator=random) / LOCK
    phases = 2 * torch.pi * torch.rand(WAVES, generator=random)
    field = (points @ waves.T + phases).cos() @ torch.randn(WAVES, 3, generator=random)
    field = field * size / field.square().sum(dim=-1).mean().sqrt()
    arc = torch.linspace(0, 1, points.shape[1])[None] * lengths(points)[:, None]
    return field * (arc / 0.02).clamp(max=1)[..., None]


def shortened(points: Points, share: float) -> Points:
    """Shorten strands by a share of their length."""
    place = torch.linspace(0, (1 - share) * (points.shape[1] - 1), points.shape[1])
    low = place.floor().long().clamp(max=points.shape[1] - 2)
    part = (place - low)[:, None]
    return points[:, low] * (1 - part) + points[:, low + 1] * part


def stage(arguments: Arguments, moves: bool) -> FitConfig:
    """A fit in which images teach the appearance and, if `moves`, the shape: nothing else does."""
    weights = FitWeights(
        geometry=0.0,
        head=0.0,
        first=0.0,
        streaks=arguments.streaks,
        shape_from_image=arguments.factor if moves else 0.0,
    )
    textures = ScalpTextureConfig(shape_size=512, appearance_knots=4)
    config = FitConfig(
        steps=arguments.shape_steps + 1 if moves else arguments.appearance_steps,
        crop=arguments.crop,
        shape_every=1 if moves else 0,
        seed=arguments.seed,
        weights=weights,
        schedule=ScheduleConfig(geometry_only=0.0, perceptual_from=1.0, final_rate=0.1),
        model=HairModelConfig(textures=textures),
    )
    return replace(config, rates=replace(config.rates, shape=arguments.rate))


def figures(model: HairModel, true: Points, seen: Bool[Tensor, "strand point"], data: FitData) -> dict[str, float]:
    """Distance of the model's strands from the true ones, and quality of its renderings."""
    with torch.no_grad():
        points = model.decode(true.shape[1]).points
        along = directions(true)
        gap = points - true
        across = (gap - (gap * along).sum(dim=-1, keepdim=True) * along).norm(dim=-1)
        renderer = HairRenderer.of(model)
        qualities = [
            image_quality(renderer.render(view.camera).rgb.clamp(0, 1), view.image, None, view.hair_mask > 0.5).psnr
            for view in list(data.views)[::6]
            if view.hair_mask is not None
        ]
    found, truth = sample_strands(points), sample_strands(true)
    precision, _ = matched_shares(sample_strands(points[::EVERY]), truth, THRESHOLDS[:2])
    recall, _ = matched_shares(sample_strands(true[::EVERY]), found, THRESHOLDS[:2])
    f_scores = [Agreement(*pair).f_score for pair in zip(precision, recall, strict=True)]
    return {
        "across_mm": round(1e3 * float(across[seen].mean()), 3),
        "across_hidden_mm": round(1e3 * float(across[~seen].mean()), 3),
        "f_1mm": round(f_scores[0], 1),
        "f_2mm": round(f_scores[1], 1),
        "length": round(float((lengths(points) / lengths(true)).median()), 3),
        "psnr_training": round(sum(qualities) / len(qualities), 2),
    }


def main(arguments: Arguments) -> None:
    """Disturb, correct and print each case."""
    keep_freed_memory()
    capture = Capture.load(arguments.capture)
    if capture.ground_truth is None or not held_out_views(len(capture), 5):
        sys.exit(f"{arguments.capture}: expected true strands and five views or more.")
    head, prior = find_head(capture), fit_prior(None, torch.device("cpu"))
    true = resample(capture.ground_truth, 100).points
    roots = attach_roots(head, true[:, 0].contiguous())
    data = gather_fit_data(
        capture, head, strand_segments(capture.ground_truth), stage(arguments, False), torch.device("cpu")
    )
    cases: list[tuple[str, float, Callable[[Points], Points]]] = [
        ("displaced", size, lambda points, size=size: points + displacement(points, size, arguments.seed))
        for size in arguments.displaced
    ]
    cases += [("cut", share, lambda points, share=share: shortened(points, share)) for share in arguments.cut]
    for kind, size, disturb in cases:
        began = time.process_time()
        first = stage(arguments, False)
        model = HairModel(first.model, roots, prior.generator, head.mesh, torch.Generator().manual_seed(arguments.seed))
        disturbed, undisturbed = (
            texture_from_latents(roots.uv, prior.encode(to_local(points, roots.position, roots.frame)), 512)
            for points in (disturb(true), true)
        )
        model.textures.shape.data.copy_(disturbed if arguments.learned_on == "disturbed" else undisturbed)
        seen = seen_points(model, true, data.views.cameras)
        fit(start_fit(model, first), data, first)
        model.textures.shape.data.copy_(disturbed)
        before = figures(model, true, seen, data)
        then = stage(arguments, True)
        state = start_fit(model, then)
        state.step = 1  # At step 0 a fit sets the first colours, which are learned by now.
        fit(state, data, then)
        result = {
            "capture": capture.folder.name,
            "case": kind,
            "size": size,
            "learned_on": arguments.learned_on,
            "strands": len(true),
            "before": before,
            "after": figures(model, true, seen, data),
            "processor_minutes": round((time.process_time() - began) / 60, 1),
        }
        sys.stdout.write(json.dumps(result) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(tyro.cli(Arguments))
