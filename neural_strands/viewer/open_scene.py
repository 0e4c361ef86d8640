"""Opens a path as a scene: a run, finished or still being fitted, a groom file, or a capture."""

import math
from dataclasses import replace
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture, has_calibration
from neural_strands.capture.head import read_head
from neural_strands.editing.hair import Hair
from neural_strands.foundation.errors import InputError
from neural_strands.grooms.io import check_suffix, read_groom
from neural_strands.lmvs.files import load_segments
from neural_strands.model.files import CONFIG_NAME, load_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.runs.edited import EDIT_NAME, POINTS, marked, open_hair
from neural_strands.runs.newest_model import StateFile, load_newest_model, newest_state
from neural_strands.runs.run_folder import RunFolder, found_again, read_description
from neural_strands.viewer.scene import Scene

WIDEST_ROOTS = 0.6
"""Largest span of the roots of hair in metres; a groom whose roots span more has another unit."""
ROOT_SPAN = 0.2
"""Typical span of the roots of a head of hair along the longest axis, metres."""


def kind_of(path: Path) -> str:
    """Return whether a path is a run, edited hair, a model, a groom or a capture, without reading it.

    Raises:
        InputError: it is none of them.
    """
    if path.is_file():
        check_suffix(path)
        return "groom"
    if not path.is_dir():
        raise InputError(f"{path}: expected a run, a groom or a capture, found nothing there; check the path.")
    if (path / EDIT_NAME).is_file():
        return "edited"
    if RunFolder(path).description.is_file():
        return "run"
    if (path / CONFIG_NAME).is_file():
        return "model"
    if has_calibration(path):
        return "capture"
    raise InputError(
        f"{path}: expected the folder of a run, edited hair, a model or a capture, found another; name one of those, "
        "or a groom file."
    )


def open_groom(path: Path) -> Scene:
    """Read a groom; if it is obviously not in metres, it is scaled to the size of a head of hair.

    Raises:
        InputError: the file is not a groom.
    """
    groom = read_groom(path)
    roots, note = groom.roots, ""
    span = float((roots.amax(dim=0) - roots.amin(dim=0)).max()) if len(groom) else 0.0
    if span > WIDEST_ROOTS:
        scale = 10.0 ** round(math.log10(ROOT_SPAN / span))
        groom = groom.transformed(torch.eye(3), scale)
        note = (
            f"This hair is too large to be in metres, so it is shown at {scale:g} times its size, where it fits a head."
        )
    strands = groom.strands(POINTS if groom.uniform_size is None else None)
    return Scene(path, "groom", note=note).with_hair(Hair(strands))


def open_capture(path: Path) -> Scene:
    """Open a capture: cameras, photographs, and its head and true strands if there are any.

    Raises:
        InputError: the folder is not a capture, or one of its files is damaged.
    """
    capture = Capture.load(path)
    file = read_head(capture)
    head = None if file is None else file.mesh
    scene, true_strands = Scene(path, "capture", head=head, photographs=capture.views_on()), capture.ground_truth
    return scene if true_strands is None else scene.with_hair(Hair(true_strands))


def open_model(path: Path, device: torch.device) -> Scene:
    """Open the folder of a hair model without its run.

    Raises:
        InputError: the folder is not a model.
    """
    return _shown_model(Scene(path, "model"), load_hair_model(path, device))


def open_edited(path: Path, device: torch.device) -> Scene:
    """Open a folder of edited hair: the source of the hair with everything around it, and the edits.

    Raises:
        InputError: the folder or its source is damaged.
    """
    edited = open_hair(path, device)
    source = edited.source
    run = RunFolder(source)
    base = open_run(source, newest_state(run), device) if run.description.is_file() else Scene(path, "")
    head = edited.fitted.model.body.mesh.to("cpu") if edited.fitted.model is not None else base.head
    scene = replace(base, path=path, kind="edited hair", head=head)
    return scene.with_hair(edited.fitted).with_edits(edited.edits)


def open_run(path: Path, state: StateFile | None, device: torch.device) -> Scene:
    """Open a run with its newest state, its segments, and its photographs if they still exist.

    Args:
        path: folder of the run.
        state: the newest state, or None before the fit has written any; then only the capture is shown.
        device: device of the renderer.

    Raises:
        InputError: a file of the run is damaged.
    """
    folder = RunFolder(path)
    described = read_description(folder)
    place = found_again(folder, described, described.capture)
    base = Scene(path, "run", note=f"The photographs are no longer in {place}.")
    if place.is_dir():
        seen = open_capture(place)
        base = Scene(path, "run", head=seen.head, photographs=seen.photographs)
    if folder.segments.is_file():
        base = replace(base, segments=load_segments(folder.segments))
    if state is None:
        return replace(base, note="The fit has not saved any hair yet; it appears here as soon as it is saved.")
    return _shown_model(base, load_newest_model(folder, state, device))


def _shown_model(base: Scene, model: HairModel) -> Scene:
    """A scene with the hair of a model, and the attributes of strands stored in the run's groom."""
    hair = marked(Hair.of(model.eval()), RunFolder(base.path).groom_arrays)
    return replace(base.with_hair(hair), head=model.body.mesh.to("cpu"))
