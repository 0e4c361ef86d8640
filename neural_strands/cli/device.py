"""The choice of a device and of a seeded generator, made once a command."""

from typing import Literal

import torch

from neural_strands.foundation.errors import InputError

DeviceName = Literal["auto", "cpu", "cuda"]


def pick_device(name: DeviceName) -> torch.device:
    """Return the named device; `auto` takes CUDA where there is one.

    Raises:
        InputError: CUDA is asked for and absent.
    """
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: expected a CUDA device, found none; use --device cpu or auto.")
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    return torch.device(name)


def seeded(seed: int, device: torch.device | str = "cpu") -> torch.Generator:
    """Return a generator with this seed: the only source of randomness of a command."""
    return torch.Generator(device=device).manual_seed(seed)
