"""Selection by a mask for which the host does not wait on a GPU."""

from collections.abc import Iterable

from jaxtyping import Bool
from torch import Tensor


def selected(mask: Bool[Tensor, " item"], values: Iterable[Tensor]) -> tuple[Tensor, ...]:
    """Values of the items that a mask marks; on a GPU, values of all items.

    On a GPU, work on unneeded items takes less time than waiting for the number of needed ones. So a caller must leave
    out unmarked items by the mask, which is selected like any other value, and must not rely on the number of items.

    Args:
        mask: which items are needed.
        values: some for each item.
    """
    if mask.device.type != "cpu":
        return tuple(values)
    places = mask.nonzero().squeeze(1)
    return tuple(each.index_select(0, places) for each in values)
