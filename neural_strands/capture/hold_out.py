"""The views of a capture that are held out for evaluation and seen by nothing else."""

FEWEST_VIEWS = 3
"""Views that a fit must be allowed to see: with fewer, nothing confirms what two of them show."""

HOLD_OUT_EVERY = 5
"""One view in so many is held out unless said otherwise."""


def held_out_views(count: int, every: int) -> list[int]:
    """Indices of the held-out views: the last of every `every` views; none for 0."""
    return [index for index in range(count) if _held_out(index, every)]


def training_views(count: int, every: int) -> list[int]:
    """Indices of the views that a reconstruction may use: all but those held out."""
    return [index for index in range(count) if not _held_out(index, every)]


def _held_out(index: int, every: int) -> bool:
    return every > 0 and index % every == every - 1
