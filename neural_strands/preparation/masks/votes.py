"""Stores how the views voted on hair, between stages."""

from pathlib import Path

import numpy as np
from jaxtyping import Float64

from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.preparation.stage import ADVICE

VOTES = "votes.npz"


def write_votes(folder: Path, vote: Float64[np.ndarray, " vertex"]) -> None:
    """Write the share of the views that see hair in front of each vertex of the head; NaN if no view shows it."""
    np.savez(folder / VOTES, vote=vote)


def read_votes(folder: Path, vertices: int) -> Float64[np.ndarray, " vertex"]:
    """Read what `write_votes` wrote for a head of so many vertices.

    Raises:
        InputError: the file is missing or damaged.
    """
    spec = ArraySpec("vote", str(vertices), np.float64, finite=False)
    return read_npz(folder / VOTES, "the views' votes on hair", (spec,), ADVICE)["vote"]
