"""The pictures of a preparation and the masks found in them, as views."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import Part, Views
from neural_strands.preparation.photographs.folder import read_mask, read_picture


def masked_views(
    cameras: Sequence[Camera],
    pictures: Sequence[Path],
    masks: Sequence[Path],
    people: Sequence[Path | None],
) -> Views:
    """Views that read a picture or mask when it is needed.

    Args:
        cameras: cameras of the views.
        pictures: the undistorted pictures.
        masks: the hair mask of each picture.
        people: a mask of the person for each picture, if there is one.

    Raises:
        InputError: when read, a file is missing or damaged.
    """

    def read(index: int, part: Part) -> Tensor | None:
        if part == "image":
            pixels = read_picture(pictures[index])
        else:
            file = masks[index] if part == "hair_mask" else people[index]
            if file is None:
                return None
            pixels = read_mask(file, (cameras[index].width, cameras[index].height))
        return torch.from_numpy(pixels.astype(np.float32) / 255)

    return Views(tuple(cameras), (True,) * len(cameras), read)
