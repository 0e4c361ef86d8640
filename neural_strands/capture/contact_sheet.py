"""A contact sheet: all photographs of a capture with the borders of their masks and of the head, in one picture."""

import math
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Int64, UInt8
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.geometry.mesh import Mesh
from neural_strands.pictures.encoding import to_bytes, write_png
from neural_strands.raster.triangles import rasterise_triangles

TILE = 320
"""Longer side of each photograph, pixels."""
MOST_WIDE = 2048
"""Width up to which the sheet grows; then further rows are added."""
CAPTION = 18
"""Height of the line with the name, pixels."""
HAIR, PERSON, HEAD, SCALP = (0, 255, 0), (80, 160, 255), (255, 220, 0), (255, 60, 60)
"""Colours of the borders, RGB."""
DIMMED = 0.45
"""Brightness of what lies outside the hair mask, relative to the photograph's."""
GROUND, INK = 24, 230
"""Grey of the sheet and of the names."""


def write_contact_sheet(
    path: Path, capture: Capture, head: Mesh | None = None, scalp_faces: Int64[Tensor, " scalp"] | None = None
) -> None:
    """Draw every view: green around the hair mask, blue around the person mask, yellow around the head, red the scalp.

    Photographs are dimmed outside the hair mask. A view that cannot be read is left blank.

    Args:
        path: PNG file to write.
        capture: the capture.
        head: the head in the cameras' frame, if it is known.
        scalp_faces: its faces that hair grows from.

    Raises:
        InputError: the file cannot be written.
    """
    tiles = [_tile(capture, index, head, scalp_faces) for index in track(range(len(capture)), "drawing the sheet")]
    height, width = (max(tile.shape[axis] for tile in tiles) for axis in (0, 1))
    columns = min(len(tiles), max(1, MOST_WIDE // width), math.ceil(math.sqrt(len(tiles) * 1.5 * height / width)))
    rows = math.ceil(len(tiles) / columns)
    sheet = np.full((rows * height, columns * width, 3), GROUND, np.uint8)
    for number, tile in enumerate(tiles):
        top, left = (number // columns) * height, (number % columns) * width
        sheet[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    write_png(path, sheet)


def _tile(
    capture: Capture, index: int, head: Mesh | None, scalp_faces: Int64[Tensor, " scalp"] | None
) -> UInt8[np.ndarray, "height width 3"]:
    """One small photograph with its name below."""
    views = capture.subset([index]).views_on().reduced(TILE)
    camera = views.cameras[0]
    picture = np.full((camera.height, camera.width, 3), GROUND, np.uint8)
    try:
        picture = to_bytes(views.image(0))
        hair, person = views.hair_mask(0), views.person_mask(0)
    except InputError:
        # The table of checks says what is wrong with the file.
        hair, person = None, None
    if hair is not None:
        inside = hair.numpy()[..., None]
        picture = (picture * (DIMMED + (1.0 - DIMMED) * inside)).astype(np.uint8)
    if head is not None:
        face = rasterise_triangles(camera.posed(head.vertices), head.faces, camera).face
        _outline(picture, (face >= 0).numpy(), HEAD)
        if scalp_faces is not None:
            _outline(picture, torch.isin(face, scalp_faces).numpy(), SCALP)
    for mask, colour in ((person, PERSON), (hair, HAIR)):
        if mask is not None:
            _outline(picture, (mask > 0.5).numpy(), colour)
    caption = np.full((CAPTION, picture.shape[1], 3), GROUND, np.uint8)
    cv2.putText(caption, camera.name, (4, CAPTION - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (INK,) * 3, 1, cv2.LINE_AA)
    return np.concatenate([picture, caption])


def _outline(
    picture: UInt8[np.ndarray, "height width 3"], mask: Bool[np.ndarray, "height width"], colour: tuple[int, int, int]
) -> None:
    """Draw the border of a mask, one pixel wide, into a picture."""
    borders, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, borders, -1, colour, 1)
