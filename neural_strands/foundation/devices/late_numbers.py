"""Numbers that a GPU works out while the host queues further work that does not depend on them."""

import torch
from jaxtyping import Int
from torch import Tensor


class LateNumbers:
    """Some whole numbers on a device, on their way to the host."""

    def __init__(self, numbers: Int[Tensor, " number"]) -> None:
        """Queue the copy to the host, which goes on at once."""
        self._numbers, self._arrived = numbers, None
        if numbers.device.type == "cuda":
            self._numbers = torch.zeros(len(numbers), dtype=numbers.dtype).pin_memory()
            self._numbers.copy_(numbers, non_blocking=True)
            self._arrived = torch.cuda.Event()
            self._arrived.record()

    def read(self) -> list[int]:
        """The numbers. The host waits only for work that was queued before the copy."""
        if self._arrived is not None:
            self._arrived.synchronize()
        return self._numbers.tolist()
