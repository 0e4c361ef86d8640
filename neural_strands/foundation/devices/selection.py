"""Selection by a mask, where the number of selected items matters to nobody but the processor."""

from collections.abc import Iterable

from jaxtyping import Bool
from torch import Tensor


def selected(mask: Bool[Tensor, " item"], values: Iterable[Tensor]) -> tuple[Tensor, ...]:
    """Values of the items that a mask marks; on a GPU, values of all items.

    A GPU computes what nobody needs sooner than the host learns how many items there are. So whoever calls this must
    leave out unmarked items by the mask, which is selected like any other value, and not by their number.

    Args:
        mask: which items are needed.
        values: some for each item.
    """
    if mask.device.type != "cpu":
        return tuple(values)
    places = mask.nonzero().squeeze(1)
    return tuple(each.index_select(0, places) for each in values)
