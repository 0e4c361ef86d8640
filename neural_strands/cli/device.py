"""The choice of a device and of a seeded generator, made once per command."""

import os
from typing import TYPE_CHECKING, Literal

from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    import torch

DeviceName = Literal["auto", "cpu", "cuda"]


def pick_device(name: DeviceName) -> "torch.device":
    """Return the named device; `auto` is CUDA if available, and torchrun's processes take one GPU each.

    Raises:
        InputError: CUDA is requested but absent, or torchrun started more processes than there are GPUs.
    """
    import torch

    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: expected a CUDA device, found none; use --device cpu or auto.")
    if name == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    number, there = int(os.environ.get("LOCAL_RANK", "0")), torch.cuda.device_count()
    if number >= there:
        raise InputError(f"torchrun: expected at most {there} processes, one per GPU, found number {number + 1}.")
    # NCCL and Warp ask for the current device.
    torch.cuda.set_device(number)
    return torch.device("cuda", number)


def leads() -> bool:
    """Whether this process speaks for all of those that torchrun started."""
    return int(os.environ.get("RANK", "0")) == 0


def seeded(seed: int, device: "torch.device | str" = "cpu") -> "torch.Generator":
    """Return a generator with this seed: the only source of randomness of a command."""
    import torch

    return torch.Generator(device=device).manual_seed(seed)
