"""How exactly CUDA computes."""

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def exact_convolutions() -> Iterator[None]:
    """Convolutions in float32 proper: cuDNN rounds what it multiplies to 11 bits (TF32) unless it is told not to.

    A variance taken as the mean of squares less the square of the mean does not survive that. The setting is the
    process's; it is put back at the end.
    """
    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    try:
        yield
    finally:
        torch.backends.cudnn.allow_tf32 = before
