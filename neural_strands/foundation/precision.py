"""The precision of convolutions."""

import contextlib
import functools
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def exact_convolutions() -> Iterator[None]:
    """Run convolutions in full float32 within the block; by default cuDNN rounds the factors to 11 bits (TF32).

    Variances computed as the mean of squares minus the square of the mean would be useless then. The setting is global
    to the process and is restored at the end.
    """
    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    try:
        yield
    finally:
        torch.backends.cudnn.allow_tf32 = before


@functools.cache
def has_bfloat16_matrices() -> bool:
    """Whether this processor multiplies matrices of bfloat16 itself (Intel's AMX), so that convolutions of it are fast.

    Without such instructions they take longer than in float32.
    """
    found = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return found is not None and bool(found())
