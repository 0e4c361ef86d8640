"""A number that a GPU works out while the host queues further work that does not depend on it."""

import torch
from jaxtyping import Int
from torch import Tensor


class LateNumber:
    """A whole number on a device, on its way to the host."""

    def __init__(self, number: Int[Tensor, ""]) -> None:
        """Queue the copy to the host, which goes on at once."""
        self._number, self._arrived = number, None
        if number.device.type == "cuda":
            self._number = torch.zeros((), dtype=number.dtype).pin_memory()
            self._number.copy_(number, non_blocking=True)
            self._arrived = torch.cuda.Event()
            self._arrived.record()

    def read(self) -> int:
        """The number. The host waits only for work that was queued before the copy."""
        if self._arrived is not None:
            self._arrived.synchronize()
        return int(self._number)
