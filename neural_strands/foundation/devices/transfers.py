"""Copies from the host to a GPU for which the host does not wait.

A plain copy waits until the GPU has done everything that was queued before. From pinned memory, which the system does
not move, the copy is queued like any other work.
"""

import torch
from torch import Tensor


def sent(tensor: Tensor, device: torch.device | str) -> Tensor:
    """The tensor on a device, itself if it is there already; the host goes on at once."""
    if torch.device(device).type != "cuda" or tensor.device.type != "cpu":
        return tensor.to(device)
    return tensor.pin_memory().to(device, non_blocking=True)
