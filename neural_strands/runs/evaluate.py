"""Evaluates a finished or stopped fit."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import held_out_views, training_views
from neural_strands.evaluation.exposure_match import mean_matched_psnr
from neural_strands.evaluation.geometry_metrics import (
    THRESHOLDS,
    GeometryScore,
    HeadFit,
    fit_to_head,
    score_geometry,
)
from neural_strands.evaluation.lpips import TRAINING_NETWORK, find_lpips, training_note
from neural_strands.evaluation.oriented_points import sample_segments, sample_strands
from neural_strands.evaluation.strand_lengths import LengthAgreement, compare_lengths
from neural_strands.evaluation.strands_in_view import StrandsInView, mean_strands_in_view, strands_in_view
from neural_strands.evaluation.timing import time_function
from neural_strands.evaluation.view_quality import RenderedView, ViewQuality, mean_quality, view_qualities
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.precision import exact_convolutions
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.views import View, Views
from neural_strands.lmvs.files import load_segments
from neural_strands.model.files import load_hair_model
from neural_strands.model.outputs import RenderOutput
from neural_strands.model.renderer import HairRenderer
from neural_strands.runs.outputs import parts_unseen
from neural_strands.runs.run_folder import RunFolder, fingerprint, found_again, read_description
from neural_strands.scalp.head import Head

GRAIN = 0.75
"""Strength of the grain in pictures that are compared with photographs: more of it brings LPIPS closer, but PSNR, SSIM
and FLIP farther, because grain never matches the photograph's pixel by pixel."""


@dataclass(frozen=True)
class Evaluation:
    """All figures of a run, and the data for its pictures.

    Attributes:
        ours: strands against the ground truth, if there is one.
        lmvs: segments against the ground truth, if there is one.
        strand_count: number of strands.
        segment_count: number of segments.
        lengths: lengths of the strands against the true ones, if there are true ones that grow from the same roots.
        head_fit: position of the strands relative to the head.
        views: held-out views, or training views if none was held out, with grain over the hair.
        clean: the same views without grain, as `render` and the viewer show them.
        held_out: whether `views` were held out.
        in_views: agreement of the drawn strands with the photographs of `views`, which needs no ground truth.
        unseen: percentage of strands of which more than half was visible in no photograph.
        decode_ms: milliseconds to decode all strands.
        render_ms: milliseconds to render one view of decoded strands.
        lpips_note: why LPIPS is absent, or that this run was trained with it, or empty.
    """

    ours: tuple[GeometryScore, ...]
    lmvs: tuple[GeometryScore, ...]
    strand_count: int
    segment_count: int
    lengths: LengthAgreement | None
    head_fit: HeadFit | None
    views: list[ViewQuality]
    clean: list[ViewQuality]
    held_out: bool
    in_views: tuple[StrandsInView, ...]
    unseen: float
    decode_ms: float
    render_ms: float
    lpips_note: str

    def as_dict(self) -> dict[str, Any]:
        """The figures that `--json` prints: percent, dB, milliseconds, metres."""
        means, clean = mean_quality(self.views).as_dict(), mean_quality(self.clean).as_dict()
        hair = means["hair"] or {"psnr": None, "ssim": None, "lpips": None}
        result: dict[str, Any] = {
            "held_out_views": {
                "held_out": self.held_out,
                "count": len(self.views),
                **hair,
                "psnr_at_exposure": mean_matched_psnr([each.view for each in self.views]),
                "image": means["image"],
                "alpha": means["alpha"],
                "without_grain": {name: clean[name] for name in ("hair", "image")},
                "lpips_note": self.lpips_note,
            },
            "strands_in_views_percent": mean_strands_in_view(self.in_views).as_dict(),
            "unseen_strands_percent": self.unseen,
            "milliseconds": {"decode": self.decode_ms, "render": self.render_ms},
        }
        for name, scores in (("strands", self.ours), ("lmvs", self.lmvs)):
            result[name] = {score.threshold.name: score.as_dict() for score in scores}
        result["counts"] = {"strands": self.strand_count, "lmvs": self.segment_count}
        if self.lengths is not None:
            result["strand_lengths"] = self.lengths.as_dict()
        if self.head_fit is not None:
            result["inside_head_percent"] = self.head_fit.inside
        return result


@dataclass(frozen=True)
class RunContents:
    """A run, read from disk.

    Attributes:
        folder: the run's folder.
        capture: all its views.
        head: mesh and scalp.
        renderer: the model and its strands, decoded once.
        segments: the line segments that the fit used.
        shown: indices of the views that are evaluated.
        held_out: whether those were held out.
    """

    folder: RunFolder
    capture: Capture
    head: Head
    renderer: HairRenderer
    segments: LineSegments
    shown: list[int]
    held_out: bool


def open_run(path: Path, device: torch.device) -> RunContents:
    """Read a run.

    Raises:
        InputError: a part is missing or damaged, or the capture or its head is not the one that was fitted.
    """
    folder = RunFolder(path)
    described = read_description(folder)
    place = found_again(folder, described, described.capture)
    if not place.exists():
        raise InputError(
            f"{path}: expected the capture that was fitted at {place}, found nothing there; restore it, or move run "
            "and capture together."
        )
    capture = Capture.load(place)
    head = find_head(capture, found_again(folder, described, described.head) if described.head else None)
    if fingerprint(capture, head) != described.fingerprint:
        raise InputError(
            f"{path}: the capture {place} has changed since it was fitted (cameras, images, masks or head); "
            "restore it, or fit it again into a new folder."
        )
    head = head.to(device)
    renderer = HairRenderer.of(load_hair_model(folder.model, device))
    held = held_out_views(len(capture), described.config.hold_out_every)
    shown = held or training_views(len(capture), described.config.hold_out_every)
    segments = load_segments(folder.segments).to(device)
    return RunContents(folder, capture, head, renderer, segments, shown, bool(held))


def evaluate_run(run: RunContents, device: torch.device) -> Evaluation:
    """Compute every figure of a run."""
    truth = run.capture.ground_truth
    ours: tuple[GeometryScore, ...] = ()
    lmvs: tuple[GeometryScore, ...] = ()
    lengths: LengthAgreement | None = None
    strands = run.renderer.strands.points
    mine = sample_strands(strands)
    if truth is not None:
        true_points = sample_strands(truth.points.to(device))
        lengths = compare_lengths(strands, truth.points.to(device))
        ours = score_geometry(mine, true_points, THRESHOLDS)
        lmvs = score_geometry(sample_segments(run.segments), true_points, THRESHOLDS, with_consistency=False)
    metric, absent = find_lpips(TRAINING_NETWORK, device)
    photographs = run.capture.views_on(device)
    in_views: list[StrandsInView] = []
    clean: list[ViewQuality] = []
    views: list[ViewQuality] = []
    for plain, grainy in _rendered_views(run, photographs, in_views):
        clean += view_qualities([plain], metric)
        views += view_qualities([grainy], metric)
    camera = photographs.cameras[run.shown[0]]
    with torch.no_grad():
        decode = time_function(run.renderer.model.decode, device, runs=3)
    render = time_function(lambda: run.renderer.render(camera), device, runs=3)
    return Evaluation(
        ours=ours,
        lmvs=lmvs,
        strand_count=len(strands),
        segment_count=run.segments.segment_count,
        lengths=lengths,
        head_fit=fit_to_head(mine, run.head.mesh, run.head.scalp_faces),
        views=views,
        clean=clean,
        held_out=run.held_out,
        in_views=tuple(in_views),
        unseen=_unseen_percent(run, photographs),
        decode_ms=1e3 * decode.median,
        render_ms=1e3 * render.median,
        lpips_note=absent or training_note(TRAINING_NETWORK),
    )


def _rendered_views(
    run: RunContents, photographs: Views, in_views: list[StrandsInView]
) -> Iterator[tuple[RenderedView, RenderedView]]:
    """Render each evaluated view, and yield it without and with grain, both with the photograph.

    Also appends the agreement of its strands with the photograph to `in_views`.
    """
    renderer = _in_float32(run.renderer)
    for index in run.shown:
        view = photographs[index]
        with exact_convolutions():
            output = renderer.render(view.camera)
        in_views.append(strands_in_view(output.lines, run.renderer.strands.points, output.alpha, view))
        grainy = renderer.with_grain(output, GRAIN, seed=index)
        yield _compared(output, view), _compared(grainy, view)


def _compared(output: RenderOutput, view: View) -> RenderedView:
    """A rendering beside its photograph."""
    return RenderedView(view.camera.name, output.rgb.clamp(0, 1), view.image, view.hair_mask, output.alpha)


def _in_float32(renderer: HairRenderer) -> HairRenderer:
    """The renderer without half precision, so that scores from GPU and CPU are comparable."""
    model = copy.copy(renderer.model)
    model.config = replace(model.config, mixed_precision=False)
    return replace(renderer, model=model)


def _unseen_percent(run: RunContents, photographs: Views) -> float:
    """Percentage of strands of which the fit's photographs show less than half."""
    held_out = set(run.shown) if run.held_out else set()
    used = [camera for index, camera in enumerate(photographs.cameras) if index not in held_out]
    [parts] = parts_unseen(run.renderer.strands, used, run.head.mesh)
    share = parts.float().mean(dim=1)
    return 100 * float((share > 0.5).float().mean())
