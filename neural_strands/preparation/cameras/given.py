"""Reads cameras that another program has calibrated: COLMAP, nerfstudio, Metashape or RealityCapture."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from neural_strands.capture.colmap import find_sparse_model, read_colmap
from neural_strands.capture.transforms import read_transforms
from neural_strands.capture.view_files import ViewFiles
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.cameras.calibration import PosedLens
from neural_strands.preparation.cameras.metashape import read_metashape
from neural_strands.preparation.cameras.reality_capture import read_reality_capture
from neural_strands.preparation.cameras.stored import as_stored, cameras_of_upright
from neural_strands.preparation.photographs.folder import Photograph


def read_upright_cameras(path: Path, photographs: Sequence[Photograph], files: Sequence[Path]) -> dict[str, PosedLens]:
    """Read the cameras of photographs as `prepare` turns them, by the names of the photographs' files.

    Args:
        path: as for `read_cameras`.
        photographs: the photographs, upright.
        files: the photographs' files, or the video that they were taken from.

    Raises:
        InputError: the file is malformed.
    """
    # RealityCapture ignores EXIF's orientation, and its file states no sizes.
    lenses = read_cameras(path, as_stored(photographs, files))
    return cameras_of_upright(lenses, photographs, files)


def read_cameras(path: Path, photographs: Sequence[Photograph]) -> dict[str, PosedLens]:
    """Read cameras by image name.

    Args:
        path: a folder with a COLMAP model or transforms.json, or a transforms.json, Metashape's XML or
            RealityCapture's CSV.
        photographs: the photographs that the cameras took, as they are stored.

    Raises:
        InputError: the file is none of these, or is malformed.
    """
    if path.is_dir():
        model = find_sparse_model(path)
        if model is not None:
            return by_name(read_colmap(path, model), model)
        path = path / "transforms.json"
    if path.is_file() and path.suffix.lower() == ".json":
        return by_name(read_transforms(path), path)
    if path.is_file() and path.suffix.lower() == ".xml":
        return read_metashape(path)
    if path.is_file() and path.suffix.lower() == ".csv":
        return read_reality_capture(path, {p.source: (p.width, p.height) for p in photographs})
    raise InputError(
        f"{path}: expected cameras (a folder with a COLMAP model, transforms.json, Metashape's .xml or "
        "RealityCapture's .csv), found none of these; check the path."
    )


def by_name(views: Sequence[ViewFiles], source: Path) -> dict[str, PosedLens]:
    """Lenses and poses of a capture's views, by file name.

    Args:
        views: the views.
        source: their file or folder, for the error message.

    Raises:
        InputError: two views have images of the same name.
    """
    name, count = Counter(view.image_path.name for view in views).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"{source}: expected one camera for each photograph's name, found {count} for {name}; give photographs in "
            "different folders different names, and calibrate again."
        )
    return {view.image_path.name: PosedLens(view.lens, view.camera.world_to_camera.double().numpy()) for view in views}
