"""Views that are in memory already, for what reads them one at a time."""

from collections.abc import Sequence

from neural_strands.geometry.views import View, Views


def in_memory(views: Sequence[View]) -> Views:
    cameras, masked = tuple(view.camera for view in views), tuple(view.hair_mask is not None for view in views)
    return Views(cameras, masked, lambda index, part: getattr(views[index], part))
