"""Renderings of a capture's views as image files, from any renderer, matched to the views by name."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.capture.images import alpha_of, read_pixels, unit_tensor
from neural_strands.evaluation.lpips import SMALLEST_SIDE
from neural_strands.evaluation.view_quality import RenderedView
from neural_strands.foundation.errors import InputError

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
"""Files that count as renderings."""


def match_renderings(folder: Path, capture: Capture, indices: Sequence[int]) -> list[Path]:
    """Find the rendering of each view: the image whose name, without its suffix, is the photograph's.

    Args:
        folder: folder of the renderings, which may contain other files too.
        capture: the capture; the views need a hair mask.
        indices: indices of the views.

    Raises:
        InputError: a view has no rendering or several, has no hair mask, shares its name with another view, or is too
            small.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: expected a folder of renderings, found {'a file' if folder.exists() else 'none'}.")
    files: dict[str, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in SUFFIXES:
            files.setdefault(path.stem, []).append(path)
    views = [capture.files[index] for index in indices]
    stems = [Path(view.camera.name).stem for view in views]
    if missing := [stem for stem in stems if stem not in files]:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise InputError(
            f"{folder}: expected a rendering of each of {len(stems)} views, found none of {missing[0]}{more}; "
            f"name it {missing[0]}.png, or choose other views with --every or --all-views."
        )
    for stem, view in zip(stems, views, strict=True):
        if len(files[stem]) > 1:
            names = " and ".join(path.name for path in files[stem])
            raise InputError(f"{folder}: expected one rendering of view {stem}, found {names}; remove all but one.")
        if stems.count(stem) > 1:
            raise InputError(
                f"{capture.folder}: expected photographs of different names, found two of name {stem}; rename one."
            )
        if view.hair_mask_path is None:
            raise InputError(
                f"{capture.folder}: expected a hair mask of each view, found none of {stem}; put it into masks/, "
                "white where there is hair."
            )
        if min(view.camera.width, view.camera.height) < SMALLEST_SIDE:
            found = f"{view.camera.width} x {view.camera.height}"
            raise InputError(
                f"{capture.folder}: expected views of {SMALLEST_SIDE} pixels per side or more, found {stem} of {found}."
            )
    return [files[stem][0] for stem in stems]


def read_rendered_views(
    paths: Sequence[Path], capture: Capture, indices: Sequence[int], device: torch.device | str = "cpu"
) -> Iterator[RenderedView]:
    """Read renderings and photographs, one view at a time.

    Args:
        paths: a file for each view, as `match_renderings` found them.
        capture: the views.
        indices: indices of the views.
        device: device of the tensors.

    Raises:
        InputError: a file is not an image, or has another size than its view.
    """
    for path, index in zip(paths, indices, strict=True):
        camera = capture.cameras[index]
        rendered, alpha = read_rendering(path)
        if rendered.shape[:2] != (camera.height, camera.width):
            found = f"{rendered.shape[1]} x {rendered.shape[0]}"
            raise InputError(
                f"{path}: expected {camera.width} x {camera.height} pixels, as its view has, found {found}; "
                "render it at the size of the photograph."
            )
        yield RenderedView(
            camera.name,
            rendered.to(device),
            capture.image(index, device),
            capture.hair_mask(index, device),
            None if alpha is None else alpha.to(device),
        )


def read_rendering(path: Path) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width"] | None]:
    """Read colours as stored, sRGB in [0, 1], and the alpha channel; None if it is opaque everywhere.

    Raises:
        InputError: the file is missing or not an image.
    """
    pixels = read_pixels(path)
    colour = pixels[:, :, :3] if pixels.shape[2] > 2 else np.repeat(pixels[:, :, :1], 3, axis=2)
    alpha = alpha_of(pixels)
    if alpha is not None and alpha.min() == np.iinfo(alpha.dtype).max:
        alpha = None
    return unit_tensor(colour, "cpu"), None if alpha is None else unit_tensor(alpha, "cpu")
