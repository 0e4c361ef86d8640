"""Whether points can be hair in metres."""

from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError

LARGEST_EXTENT = 5.0
"""Extent beyond which points cannot be hair in metres."""


def check_metres(path: Path, points: Float[Tensor, "*batch 3"]) -> None:
    """Refuse points that span more than any hair, before work that grows with their extent.

    Args:
        path: the file that they come from, for the error message.
        points: positions that should be in metres.

    Raises:
        InputError: they are in another unit.
    """
    flat = points.reshape(-1, 3)
    extent = float((flat.amax(dim=0) - flat.amin(dim=0)).max()) if len(flat) else 0.0
    if extent > LARGEST_EXTENT:
        raise InputError(
            f"{path}: expected hair in metres, found something {extent:.3g} across; convert it first, for centimetres "
            "with neural-strands convert IN OUT --scale 0.01."
        )
