"""Structure from motion with COLMAP: the camera of each photograph, in an arbitrary frame and unit.

Photographs of the same device, size and focal length share a lens. The principal point is estimated in a final bundle
adjustment: portraits are often cropped off centre, and with a fixed principal point the poses would be off by degrees.
They would be, too, with an estimated one where photographs do not tell it; it then stays in the middle.
"""

import copy
import itertools
import math
import os
import shutil
import sqlite3
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.progress import track
from neural_strands.foundation.worker import started_worker
from neural_strands.preparation.cameras.calibration import SparsePoints
from neural_strands.preparation.cameras.exposures import estimate_exposures, seen_colours, write_exposures
from neural_strands.preparation.photographs.folder import FEWEST, Photograph
from neural_strands.preparation.stage import ADVICE

if TYPE_CHECKING:
    import pycolmap

SHARED_LENS = 10
"""Number of photographs with one lens from which all eight parameters are estimated; with fewer, only focal length and
one distortion coefficient."""
FREE_CENTRE = 15
"""Number of photographs with one lens from which its principal point is estimated as well."""
CENTRE_GAIN = 0.01
"""Share of the mean reprojection error that an estimated principal point must take away. Cameras on a circle about a
head can turn together instead of moving it, which changes the error by a few thousandths and the poses by degrees."""
CENTRE_RANGE = 0.15
"""Largest plausible distance of an estimated principal point from the middle, as a share of the longer side."""
DEFAULT_FOCALS = (1.2, 2.4)
"""Initial focal lengths, in multiples of the longer side, if the file has none: a wide lens and a portrait lens.

From too short a start, cameras on a circle around the head can converge to a wrong minimum.
"""
COMPARABLE = 0.95
"""Models with at least this share of the largest number of observations are compared by reprojection error."""
SEEN_BY = 3
"""Smallest number of photographs that must see a point."""
POINT_ERROR = 2.0
"""Largest mean reprojection error of a point, pixels."""
PIXEL_MEMORY, FEATURE_MEMORY = 320, 3e9
"""Bytes that COLMAP's detector takes for each pixel of a photograph, and that all of its threads together may take."""
LARGEST_DETECTED = 3200
"""Longer side to which COLMAP itself reduces photographs when it detects features, pixels."""
MATCH_ALL, PARTNERS = 50, 24
"""Largest number of photographs of which all pairs are matched, and about how many partners each has beyond that."""
ONE_THREAD = 1
"""Threads that place the cameras; several would add up in an order that differs from run to run."""
DATABASE = "database.db"
BLOCKS = 20
"""Parts in which pairs are matched, so that progress can be told."""
WORKER = Path(__file__).with_name("match_worker.py")


def match_photographs(images: Path, photographs: Sequence[Photograph], out: Path, person: Path | None = None) -> None:
    """Detect features in all photographs and match them in pairs; writes COLMAP's database into `out`.

    All pairs are matched of up to `MATCH_ALL` photographs; of more, those that look as if they overlap.

    Args:
        images: folder of the photographs.
        photographs: the photographs in that folder.
        out: an existing folder.
        person: folder of masks NAME.png.png, outside which features are ignored: what stays still behind a person who
            turns would suggest that the camera stayed still, too.

    Raises:
        InputError: pycolmap is not installed, or COLMAP failed.
    """
    _pycolmap()
    groups = _lens_groups(photographs)
    request = {
        "database": str((out / DATABASE).resolve()),
        "images": str(images.resolve()),
        "masks": None if person is None else str(person.resolve()),
        "partners": PARTNERS if len(photographs) > MATCH_ALL else None,
        "blocks": BLOCKS,
        "groups": [_lens_request(group) for group in groups],
    }
    with started_worker(None, WORKER, request, "pycolmap", isolated=False) as worker:
        told = track(worker.answers(), "finding and matching features", total=len(photographs) + BLOCKS + 1)
        said = [line.strip() for line in told]
        if said[-1:] != ["finished"] or worker.status() != 0:
            raise _failure(worker.last_words())


def _lens_request(group: Sequence[Photograph]) -> dict[str, Any]:
    """What `match_worker` is asked for photographs that share a lens."""
    first, shared = group[0], len(group) >= SHARED_LENS
    params = ""
    if first.focal > 0:
        values = [first.focal] * (2 if shared else 1)
        values += [first.width / 2, first.height / 2]
        values += [0.0] * (8 - len(values) if shared else 1)
        params = ",".join(f"{value:.4f}" for value in values)
    return {
        "names": [photograph.name for photograph in group],
        "model": "OPENCV" if shared else "SIMPLE_RADIAL",
        "params": params,
        "focal": DEFAULT_FOCALS[0],
        "threads": _detector_threads(group),
    }


def _detector_threads(group: Sequence[Photograph]) -> int:
    """As many threads of the detector as the memory allows, each of which works on one photograph."""
    sizes = [(shot.width, shot.height) for shot in group]
    shrunk = [min(1.0, LARGEST_DETECTED / max(size)) for size in sizes]
    pixels = max(width * height * scale**2 for (width, height), scale in zip(sizes, shrunk, strict=True))
    return max(1, min(os.cpu_count() or 1, int(FEATURE_MEMORY / (PIXEL_MEMORY * pixels))))


def register(
    images: Path, photographs: Sequence[Photograph], matches: Path, out: Path, say: Callable[[str], None]
) -> SparsePoints:
    """Estimate cameras and exposures of matched photographs; writes both into `out`, the cameras as a COLMAP model.

    Args:
        images: folder of the photographs.
        photographs: the photographs in that folder.
        matches: folder that `match_photographs` wrote.
        out: an existing folder.
        say: receives messages for the user.

    Raises:
        InputError: too few photographs overlap, or one cannot be read.
    """
    pycolmap = _pycolmap()
    models = []
    for focal in DEFAULT_FOCALS if any(photograph.focal <= 0 for photograph in photographs) else DEFAULT_FOCALS[:1]:
        with tempfile.TemporaryDirectory(dir=out) as attempt:
            with _reported_errors():
                database = _database_from(pycolmap, matches, Path(attempt), photographs, focal)
            models += _mapped(pycolmap, images, database, say, len(photographs))
    best = best_model(models)
    registered = 0 if best is None else best.num_reg_images()
    if best is None or registered < max(FEWEST, math.ceil(0.25 * len(photographs))):
        raise InputError(
            f"{len(photographs)} photographs: expected them to overlap so that cameras can be found, found "
            f"{registered} that do; take more, each a small step (10 to 15 degrees) from the last, of a head and a "
            "background that do not move."
        )
    best = _with_free_centres(pycolmap, best, say)
    names = {image.name for image in best.images.values() if image.has_pose}
    missing = [photograph.source for photograph in photographs if photograph.name not in names]
    say(f"{registered} of {len(photographs)} photographs have cameras, {best.num_points3D()} points.")
    if missing:
        more = f" and {len(missing) - 10} more" if len(missing) > 10 else ""
        say(f"Left out, for they do not overlap with the rest: {', '.join(missing[:10])}{more}.")
    with _reported_errors():
        best.write(out)
    names, seen = seen_colours(images, best)
    write_exposures(out, names, estimate_exposures(seen, len(names)))
    return _points(best)


def read_model(folder: Path) -> "pycolmap.Reconstruction":
    """Read the model that `register` wrote.

    Raises:
        InputError: a file is missing or damaged, or pycolmap is not installed.
    """
    pycolmap = _pycolmap()
    try:
        return pycolmap.Reconstruction(folder)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"{folder}: expected COLMAP's model, found: {reason(error)}; {ADVICE}.") from error


def best_model(models: Sequence["pycolmap.Reconstruction"]) -> "pycolmap.Reconstruction | None":
    """The model with the most cameras; of several, the one with the least error."""
    if not models:
        return None
    most = max(model.num_reg_images() for model in models)
    models = [model for model in models if model.num_reg_images() == most]
    seen = max(model.compute_num_observations() for model in models)
    alike = [model for model in models if model.compute_num_observations() >= COMPARABLE * seen]
    return min(alike, key=lambda model: model.compute_mean_reprojection_error())


def _database_from(pycolmap: Any, matches: Path, folder: Path, photographs: Sequence[Photograph], focal: float) -> Path:
    """Copy the database, with lenses of unknown focal length starting at `focal` times the longer side.

    Raises:
        InputError: it is damaged.
    """
    database = folder / DATABASE
    shutil.copyfile(matches / DATABASE, database)
    if _image_count(database) != len(photographs):
        raise InputError(
            f"{matches / DATABASE}: expected COLMAP's database of {len(photographs)} photographs, found a damaged one; "
            f"{ADVICE}."
        )
    unknown = {photograph.name for photograph in photographs if photograph.focal <= 0}
    with pycolmap.Database.open(database) as opened:
        lenses = {image.camera_id for image in opened.read_all_images() if image.name in unknown}
        for camera in opened.read_all_cameras():
            if camera.camera_id in lenses:
                params = camera.params
                params[camera.focal_length_idxs()] = focal * max(camera.width, camera.height)
                camera.params = params
                opened.update_camera(camera)
    return database


def _image_count(database: Path) -> int:
    """Number of images in a database; 0 if it is damaged, in which case COLMAP might abort the process."""
    try:
        with closing(sqlite3.connect(database)) as opened:
            (found,) = opened.execute("PRAGMA quick_check").fetchone()
            (count,) = opened.execute("SELECT COUNT(*) FROM images").fetchone()
    except sqlite3.DatabaseError:
        return 0
    return count if found == "ok" else 0


def _mapped(
    pycolmap: Any, images: Path, database: Path, say: Callable[[str], None], total: int
) -> list["pycolmap.Reconstruction"]:
    """The models that incremental mapping yields."""
    pycolmap.set_random_seed(0)
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed = 0
    options.num_threads = ONE_THREAD
    options.min_model_size = FEWEST
    seen = itertools.count(1)
    with _reported_errors():
        models = pycolmap.incremental_mapping(
            database,
            images,
            database.parent,
            options,
            next_image_callback=lambda: _report_progress(say, next(seen), total),
        )
    return list(models.values())


def _lens_groups(photographs: Sequence[Photograph]) -> list[list[Photograph]]:
    """Group photographs that share a lens according to their metadata."""
    groups: dict[tuple, list[Photograph]] = defaultdict(list)
    for photograph in photographs:
        key = (photograph.width, photograph.height, photograph.device, round(photograph.focal))
        groups[key].append(photograph)
    return list(groups.values())


def _with_free_centres(
    pycolmap: Any, model: "pycolmap.Reconstruction", say: Callable[[str], None]
) -> "pycolmap.Reconstruction":
    """The model with principal points of lenses that enough photographs share, if these tell where they are.

    Other lenses stay as they are: a single photograph of another size keeps none of the rest from it. If a principal
    point ends too far from the middle, the model is returned as it was.
    """
    count: dict[int, int] = defaultdict(int)
    for image in model.images.values():
        count[image.camera_id] += image.has_pose
    fixed = [identity for identity, photographs in count.items() if photographs < FREE_CENTRE]
    if len(fixed) == len(count) or not _centres_matter(pycolmap, model, fixed):
        return model
    freed = copy.deepcopy(model)
    _adjust(pycolmap, freed, fixed, centres=True)
    for camera in freed.cameras.values():
        offset = np.array([camera.principal_point_x - camera.width / 2, camera.principal_point_y - camera.height / 2])
        if np.abs(offset).max() > CENTRE_RANGE * max(camera.width, camera.height):
            say("The principal point could not be estimated from these photographs and stays in the middle.")
            return model
    return freed


def _centres_matter(pycolmap: Any, model: "pycolmap.Reconstruction", fixed: Sequence[int]) -> bool:
    """Whether free principal points fit the photographs better, by `CENTRE_GAIN`; the model stays as it is.

    Asked of lenses without tangential distortion, which could stand in for a principal point off the middle.
    """
    trial = copy.deepcopy(model)
    for identity, camera in trial.cameras.items():
        if identity not in fixed and camera.model == pycolmap.CameraModelId.OPENCV:
            focal, radial = camera.mean_focal_length(), camera.params[4:6]
            camera.model = pycolmap.CameraModelId.RADIAL
            camera.params = [focal, camera.width / 2, camera.height / 2, *radial]
    errors = []
    for centres in (False, True):
        _adjust(pycolmap, trial, fixed, centres)
        trial.update_point_3d_errors()
        errors.append(trial.compute_mean_reprojection_error())
    return errors[1] <= (1 - CENTRE_GAIN) * errors[0]


def _adjust(pycolmap: Any, model: "pycolmap.Reconstruction", fixed: Sequence[int], centres: bool) -> None:
    """Adjust all cameras and points but for the `fixed` lenses."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = centres
    options.ceres.solver_options.num_threads = ONE_THREAD
    options.print_summary = False
    # Not `pycolmap.bundle_adjustment`, which writes to the terminal.
    config = pycolmap.BundleAdjustmentConfig()
    for identity in model.reg_image_ids():
        config.add_image(identity)
    for identity in fixed:
        config.set_constant_cam_intrinsics(identity)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def _points(model: "pycolmap.Reconstruction") -> SparsePoints:
    kept = [p for p in model.points3D.values() if p.track.length() >= SEEN_BY and p.error <= POINT_ERROR]
    position = np.array([point.xyz for point in kept], dtype=np.float64).reshape(-1, 3)
    return SparsePoints(position, np.array([point.color for point in kept], dtype=np.uint8).reshape(-1, 3))


def _report_progress(say: Callable[[str], None], number: int, total: int) -> None:
    """Report progress occasionally, because mapping takes minutes; photographs may be tried more than once."""
    if number % 10 == 0 and number <= total:
        say(f"Placed {number} of {total} photographs.")


@contextmanager
def _reported_errors() -> Iterator[None]:
    """Turn COLMAP's errors (a full disk, a picture that changed) into one sentence.

    Raises:
        InputError: COLMAP failed.
    """
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise _failure(reason(error)) from error


def _failure(found: str) -> InputError:
    return InputError(
        f"Finding cameras: expected COLMAP to finish, found: {found.strip()}; see that the disk has room, or give "
        "cameras with --cameras."
    )


def _pycolmap() -> Any:
    try:
        import pycolmap
    except ImportError as error:
        raise InputError(
            "Finding cameras: expected the package pycolmap, found none; run `pip install 'neural-strands[photos]'`, "
            "or give cameras with --cameras."
        ) from error
    # What it reports as an error, such as that no model was found, becomes one sentence here.
    pycolmap.logging.minloglevel = pycolmap.logging.Level.FATAL.value
    return pycolmap
