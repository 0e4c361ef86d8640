"""The views of a capture that are held out and used only for evaluation."""

FEWEST_VIEWS = 3
"""Smallest number of training views: with fewer, nothing confirms what two views show."""

HOLD_OUT_EVERY = 5
"""By default, one view in this many is held out."""


def held_out_views(count: int, every: int) -> list[int]:
    """Indices of the held-out views: the last of each group of `every` views; none if it is 0."""
    return [index for index in range(count) if _held_out(index, every)]


def training_views(count: int, every: int) -> list[int]:
    """Indices of the views that a reconstruction may use: all but those held out."""
    return [index for index in range(count) if not _held_out(index, every)]


def _held_out(index: int, every: int) -> bool:
    return every > 0 and index % every == every - 1
