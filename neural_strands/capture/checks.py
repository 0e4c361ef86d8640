"""Runs all checks of a capture before a long run."""

from pathlib import Path

from neural_strands.capture.capture import Capture
from neural_strands.capture.check_head import check_agreement, check_head
from neural_strands.capture.check_images import check_exposure, check_files, check_masks, check_sharpness, gather
from neural_strands.capture.check_views import check_aim, check_doubles, check_scale, check_viewpoints
from neural_strands.capture.findings import Finding
from neural_strands.capture.mask_border import check_border
from neural_strands.foundation.errors import InputError


def check_capture(folder: Path, head_file: Path | None = None) -> list[Finding]:
    """Check every part of a capture folder, in the order in which a user would fix it.

    Args:
        folder: the capture.
        head_file: head mesh that replaces the capture's own, if any.

    Raises:
        InputError: the calibration itself cannot be read, so that nothing else can be checked.
    """
    capture = Capture.load(folder)
    head, scalp, head_finding = check_head(capture, head_file)
    facts = gather(capture)
    cameras = capture.cameras
    doubles, scale = check_doubles(cameras), check_scale(cameras, head)
    agreement = None
    # A head in another unit agrees with no mask; the scale check already reports that.
    if head is not None and scalp is not None and scale.level != "error":
        agreement = check_agreement(capture, facts, head, scalp)
    border = None if any(fact.problem for fact in facts) else check_border(capture)
    return [
        _calibration(capture),
        *check_files(facts),
        check_masks(facts, "hair"),
        *([] if border is None else [border]),
        check_masks(facts, "person"),
        head_finding,
        scale,
        *([] if agreement is None else [agreement]),
        check_aim(cameras, head),
        check_viewpoints(cameras, head),
        *([] if doubles is None else [doubles]),
        check_sharpness(facts),
        check_exposure(capture, facts),
        _ground_truth(capture),
    ]


def _calibration(capture: Capture) -> Finding:
    sizes = sorted({(camera.width, camera.height) for camera in capture.cameras})
    lenses = {view.lens for view in capture.files}
    bent = sum(view.lens.distorts for view in capture.files)
    text = f"{len(capture)} views of {', '.join(f'{width} x {height}' for width, height in sizes[:3])} pixels"
    text += f" and {len(sizes) - 3} more sizes" if len(sizes) > 3 else ""
    text += f", {len(lenses)} {'lens' if len(lenses) == 1 else 'lenses'}"
    return Finding("calibration", "good", text + (f", distortion removed in {bent}" if bent else ""))


def _ground_truth(capture: Capture) -> Finding:
    try:
        truth = capture.ground_truth
    except InputError as error:
        return Finding("ground truth", "error", str(error).rstrip("."), "fix the file or remove it")
    if truth is None:
        return Finding("ground truth", "note", "none (real captures have none)")
    return Finding("ground truth", "good", f"{len(truth)} strands of {truth.points_per_strand} points")
