"""Everything that can be said about a capture before hours are spent on it."""

from pathlib import Path

from neural_strands.capture.capture import Capture
from neural_strands.capture.check_images import check_exposure, check_files, check_masks, check_sharpness, gather
from neural_strands.capture.check_views import check_aim, check_doubles, check_scale, check_viewpoints
from neural_strands.capture.findings import Finding
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh


def check_capture(folder: Path) -> list[Finding]:
    """Look at every part of a capture folder, in the order in which a user would mend it.

    Raises:
        InputError: the calibration itself cannot be read, so that nothing else can be said.
    """
    capture = Capture.load(folder)
    head, head_finding = _head(capture)
    facts = gather(capture)
    cameras = capture.cameras
    doubles = check_doubles(cameras)
    return [
        _calibration(capture),
        *check_files(facts),
        check_masks(facts, "hair"),
        check_masks(facts, "person"),
        head_finding,
        check_scale(cameras, head),
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
    return Finding("calibration", "good", text + (f", distortion undone in {bent}" if bent else ""))


def _head(capture: Capture) -> tuple[Mesh | None, Finding]:
    try:
        head, scalp = capture.head, capture.scalp_faces
    except InputError as error:
        return None, Finding("head", "error", str(error).rstrip("."), "mend the file or remove it")
    if head is None:
        action = "put the fitted head there as head.obj, or let the fit start from the built-in mannequin"
        return None, Finding("head", "note", "no head mesh", action)
    text = f"{len(head.faces)} triangles"
    if scalp is None:
        return head, Finding("head", "note", f"{text}, no scalp_faces.json", "the scalp will be found from the shape")
    return head, Finding("head", "good", f"{text}, {len(scalp)} of them scalp")


def _ground_truth(capture: Capture) -> Finding:
    try:
        truth = capture.ground_truth
    except InputError as error:
        return Finding("ground truth", "error", str(error).rstrip("."), "mend the file or remove it")
    if truth is None:
        return Finding("ground truth", "note", "none (real captures have none)")
    return Finding("ground truth", "good", f"{len(truth)} strands of {truth.points_per_strand} points")
