"""Finds what a preparation starts from: photographs, a video, or a model of calibrated photographs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from neural_strands.capture.capture import has_calibration
from neural_strands.capture.colmap import find_sparse_model, read_colmap
from neural_strands.capture.transforms import read_transforms
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.photographs.folder import find_photographs, list_photographs
from neural_strands.preparation.photographs.video import is_video


@dataclass(frozen=True)
class Source:
    """Photographs, or one video.

    Attributes:
        files: the photographs, or the video alone.
        is_video: whether it is a video.
        cameras: file or folder with the photographs' cameras; None if they have to be estimated.
    """

    files: tuple[Path, ...]
    is_video: bool
    cameras: Path | None


def find_source(path: Path, cameras: Path | None) -> Source:
    """Find the photographs that a user names, directly or by a model that they belong to.

    A model is a folder with a COLMAP model or transforms.json and without photographs of its own, or transforms.json,
    Metashape's XML or RealityCapture's CSV.

    Args:
        path: a folder of photographs, a video, or a model.
        cameras: file or folder with the cameras, if the user names one; `path` is then no model.

    Raises:
        InputError: there are no such photographs.
    """
    if is_video(path) and path.is_file():
        return Source((path,), True, cameras)
    images = _images_of(path) if cameras is None else None
    if images is None:
        return Source(tuple(find_photographs(path)), False, cameras)
    missing = next((image for image in images if not image.is_file()), None)
    if missing is not None:
        raise _elsewhere(path, f"no {missing}")
    return Source(tuple(images), False, path)


def has_unused_cameras(source: Source) -> bool:
    """Whether a folder of photographs also contains a model that is not used."""
    folder = source.files[0].parent
    return source.cameras is None and not source.is_video and has_calibration(folder)


def _images_of(path: Path) -> Sequence[Path] | None:
    """The photographs of a model; None if the path is not a model."""
    suffix = path.suffix.lower()
    if path.is_file() and suffix == ".json":
        return [view.image_path for view in read_transforms(path)]
    if path.is_file() and suffix in (".xml", ".csv"):
        # These name photographs but no folder; the usual one is their own.
        images = list_photographs(path.parent)
        if not images:
            raise _elsewhere(path, f"none in {path.parent}")
        return images
    if not path.is_dir() or list_photographs(path):
        return None
    model = find_sparse_model(path)
    if model is not None:
        return _colmap_images(path, model)
    transforms = path / "transforms.json"
    return _images_of(transforms) if transforms.is_file() else None


def _colmap_images(path: Path, model: Path) -> Sequence[Path]:
    """The images of a COLMAP model, which lie in `images` beside it or above it, or in such a folder itself."""
    names = [view.camera.name for view in read_colmap(path, model)]
    above = model.resolve().parents
    bases = (path, *above[:2])
    roots = [root for base in bases for root in (base / "images", base)]
    root = next((root for root in roots if (root / names[0]).is_file()), path / "images")
    return [root / name for name in names]


def _elsewhere(path: Path, found: str) -> InputError:
    return InputError(
        f"{path}: expected the photographs of these cameras beside it, found {found}; name the folder of the "
        f"photographs instead, and pass --cameras {path}."
    )
