"""The functions of `import neural_strands as ns` that are not simply re-exported from another module.

They accept paths as text or `Path`, lengths in metres, and devices with PyTorch's names. The package loads this module
when one of its names is first used. The examples run as tests, in a folder with a small capture, its line segments and
a run.
"""

from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import training_views
from neural_strands.editing.haircut import cut_hair
from neural_strands.editing.settings import Haircut
from neural_strands.evaluation.geometry_metrics import GeometryScore, score_geometry
from neural_strands.evaluation.oriented_points import (
    STEP,
    OrientedPoints,
    sample_curves,
    sample_segments,
    sample_strands,
)
from neural_strands.evaluation.score_files import read_oriented_points
from neural_strands.fitting.config import FitConfig, check_fit_config
from neural_strands.fitting.stereo import find_segments, segments_source
from neural_strands.foundation.configs import check_config
from neural_strands.foundation.progress import Feedback
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom as write_groom_file
from neural_strands.lmvs.files import save_segments
from neural_strands.model.files import load_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.model.outputs import RenderOutput
from neural_strands.model.renderer import HairRenderer
from neural_strands.runs.evaluate import Evaluation, evaluate_run, open_run
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.runs.run_folder import RunFolder

Device = torch.device | str
SixNumbers = tuple[float, float, float, float, float, float]


def load_capture(folder: Path | str) -> Capture:
    """Read the cameras of a capture and locate its images, which are decoded when they are needed.

    Args:
        folder: folder with images and `transforms.json` (nerfstudio) or a COLMAP model.

    Raises:
        InputError: there is no calibration, or it is malformed.

    Examples:
        >>> import neural_strands as ns
        >>> capture = ns.load_capture("capture")
        >>> len(capture), capture.cameras[0].name, tuple(capture.image(0).shape)
        (10, '000.png', (64, 64, 3))
    """
    return Capture.load(folder)


def make_segments(
    capture: Capture,
    path: Path | str | None = None,
    config: FitConfig | None = None,
    *,
    head: Path | str | None = None,
    device: Device = "cpu",
) -> LineSegments:
    """Reconstruct line segments by multi-view stereo, signed from root to tip, from the views that a fit may use.

    Args:
        capture: all views; those that `config` holds out are not used.
        path: npz file to write, for `fit(segments=...)`; it records the views that were used.
        config: settings `stereo`, `growth`, `hold_out_every` and `seed`; by default those of `preset("fast")`.
        head: mesh in the cameras' frame, instead of the capture's own.
        device: device of the stereo; the segments are returned on the CPU.

    Raises:
        InputError: there is no head, or fewer than two views show hair.

    Examples:
        >>> import neural_strands as ns
        >>> segments = ns.make_segments(ns.load_capture("capture"), "found.npz")
        >>> len(segments) > 100, segments.points.shape == segments.directions.shape
        (True, True)
    """
    config = FitConfig() if config is None else config
    check_fit_config(config)
    seen = capture.subset(training_views(len(capture), config.hold_out_every))
    found_head = find_head(capture, None if head is None else Path(head))
    segments = find_segments(seen, found_head, config, None, Feedback().track, device)
    if path is not None:
        save_segments(Path(path), segments, segments_source(seen, config))
    return segments


def fit(
    capture: Path | str,
    out: Path | str,
    config: FitConfig | None = None,
    *,
    head: Path | str | None = None,
    segments: Path | str | None = None,
    resume: bool = False,
    device: Device = "cpu",
    feedback: Feedback | None = None,
) -> RunFolder:
    """Reconstruct the hair of a capture into a folder, as `neural-strands fit` does.

    Args:
        capture: folder of the capture.
        out: folder of the run.
        config: all settings; by default those of `preset("fast")`, which takes up to half an hour on two cores.
        head: mesh in the cameras' frame, metres, instead of the capture's own.
        segments: npz file of line segments from `make_segments`; without it they are computed.
        resume: continue the run in `out`.
        device: where to compute.
        feedback: receives a sentence at each stage and the progress of loops; by default nothing is reported.

    Returns:
        Paths of the results: `.groom` (USD), `.groom_arrays` (npz), `.model`, and `.path` of the folder.

    Raises:
        InputError: the input makes a fit impossible; nothing is written then.

    Examples:
        >>> import neural_strands as ns
        >>> from dataclasses import replace
        >>> config = replace(ns.preset("demo"), steps=2, strands=100, initialise="mean")
        >>> run = ns.fit("capture", "new_run", config, segments="segments.npz")
        >>> len(ns.read_groom(run.groom))
        100
    """
    config = FitConfig() if config is None else config
    check_fit_config(config)
    request = FitRequest(
        capture=Path(capture),
        out=Path(out),
        head=None if head is None else Path(head),
        segments=None if segments is None else Path(segments),
        resume=resume,
    )
    run_fit(request, config, torch.device(device), Feedback() if feedback is None else feedback)
    return RunFolder(Path(out))


def evaluate(run: Path | str, device: Device = "cpu") -> Evaluation:
    """Score a run: its held-out views, and its strands if the capture has true ones.

    Raises:
        InputError: there is no run, or its capture has changed.

    Examples:
        >>> import neural_strands as ns
        >>> figures = ns.evaluate("run").as_dict()
        >>> figures["held_out_views"]["count"], figures["held_out_views"]["psnr"] > 5
        (2, True)
    """
    there = torch.device(device)
    return evaluate_run(open_run(Path(run), there), there)


def load_model(folder: Path | str, device: Device = "cpu") -> HairModel:
    """Read the hair model of a run, given the run's folder or the model's own.

    Raises:
        InputError: the folder has no model, or a damaged one.

    Examples:
        >>> import neural_strands as ns
        >>> model = ns.load_model("run")
        >>> model.config.points
        24
    """
    folder = Path(folder)
    inner = RunFolder(folder).model
    return load_hair_model(inner if inner.is_dir() else folder, device).eval()


@torch.no_grad()
def decode(model: HairModel, points: int | None = None) -> Strands:
    """Decode the strands of a model, in world metres, root first.

    Args:
        model: from `load_model`.
        points: points per strand, any number; by default those of the model.

    Examples:
        >>> import neural_strands as ns
        >>> strands = ns.decode(ns.load_model("run"), points=50)
        >>> tuple(strands.points.shape), tuple(strands.root_uv.shape)
        ((200, 50, 3), (200, 2))
    """
    return model.decode(points)


def render(model: HairModel, camera: Camera, strands: Strands | None = None) -> RenderOutput:
    """Render one view; for many views of the same strands keep a `HairRenderer`, which decodes them once.

    Args:
        model: from `load_model`.
        camera: a capture's camera, one from `turntable_cameras`, or your own.
        strands: edited strands to show instead of the model's own, with `root_uv`; they are relit.

    Returns:
        Images of the camera's size: `rgb` (sRGB, not clamped), `alpha` of the hair, and more.

    Raises:
        InputError: the view does not fit into memory.
        ValueError: the strands have no `root_uv`.

    Examples:
        >>> import neural_strands as ns
        >>> camera = ns.load_capture("capture").cameras[4]
        >>> picture = ns.render(ns.load_model("run"), camera)
        >>> tuple(picture.rgb.shape), tuple(picture.alpha.shape)
        ((64, 64, 3), (64, 64))
    """
    fitted = HairRenderer.of(model)
    return (fitted if strands is None else fitted.showing(strands)).render(camera)


def cut(
    strands: Strands,
    *,
    length: float | None = None,
    fraction: float | None = None,
    plane: SixNumbers | None = None,
    box: SixNumbers | None = None,
    mesh: Path | str | None = None,
    uneven: float = 0.003,
    seed: int = 0,
) -> Strands:
    """Cut strands in one of five ways; the remaining part of a strand keeps its appearance.

    Args:
        strands: with `root_uv` if they are to be rendered.
        length: longest strand that remains, metres.
        fraction: share of every strand that is cut off, from 0 to 1.
        plane: a point and a normal (six numbers, metres): what lies on the side of the normal is cut.
        box: two opposite corners (six numbers, metres): what lies outside is cut.
        mesh: file of a closed mesh in world metres: what lies outside is cut.
        uneven: largest additional length that is cut off at random, metres, so that the edge looks cut by hand.
        seed: seed of the uneven edge.

    Raises:
        InputError: none or several ways are given, a value is out of range, or no hair would remain.

    Examples:
        >>> import neural_strands as ns
        >>> strands = ns.decode(ns.load_model("run"))
        >>> shorter = ns.cut(strands, length=0.03)
        >>> bool(shorter.points.diff(dim=1).norm(dim=-1).sum(dim=1).max() < 0.0301)
        True
    """
    shape = None if mesh is None else str(mesh)
    haircut = Haircut(length, fraction, plane, box, shape, uneven, seed=seed)
    check_config(haircut, "cut")
    return cut_hair(haircut, strands)


def write_groom(path: Path | str, strands: Strands | Groom) -> None:
    """Write strands to a groom file: .usd, .usda, .usdc, .ply, .obj, .hair, .data, .tfx or .npz, by the suffix.

    Raises:
        InputError: the suffix is unknown, the strands have values that no reader accepts, or the file cannot be
            written.

    Examples:
        >>> import neural_strands as ns
        >>> strands = ns.decode(ns.load_model("run"))
        >>> ns.write_groom("hair.usda", strands)
        >>> len(ns.read_groom("hair.usda")) == len(strands)
        True
    """
    write_groom_file(path, strands if isinstance(strands, Groom) else Groom.from_strands(strands))


def score(
    predicted: Path | str | Strands | Groom | LineSegments, truth: Path | str | Strands | Groom, step: float = STEP
) -> dict[str, GeometryScore]:
    """Compare strands with true strands: precision, recall, F and strand consistency, in percent.

    Args:
        predicted: strands or line segments in metres, or a file of them.
        truth: true strands in metres, or their file; also the folder of a capture with `ground_truth.npz`.
        step: largest distance between samples along a strand, metres.

    Returns:
        Scores by threshold: "1mm/10deg", "2mm/20deg", "3mm/30deg" and "4mm/40deg".

    Raises:
        InputError: a file cannot be read, or is not in metres.

    Examples:
        >>> import neural_strands as ns
        >>> ns.score("capture", "capture")["2mm/20deg"].unsigned.f_score
        100.0
        >>> ns.score("segments.npz", "capture")["1mm/10deg"].unsigned.precision > 90
        True
    """
    scores = score_geometry(_oriented_points(predicted, step), _oriented_points(truth, step))
    return {each.threshold.name: each for each in scores}


def _oriented_points(source: Path | str | Strands | Groom | LineSegments, step: float) -> OrientedPoints:
    """Sample strands or segments from a file or in memory."""
    if isinstance(source, Strands):
        return sample_strands(source.points, step)
    if isinstance(source, Groom):
        return sample_curves(source.vertices, source.offsets, step)
    if isinstance(source, LineSegments):
        return sample_segments(source, step)
    return read_oriented_points(Path(source), step)
