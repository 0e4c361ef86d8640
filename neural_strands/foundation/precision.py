"""The precision of CUDA convolutions."""

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def exact_convolutions() -> Iterator[None]:
    """Convolutions in full float32: by default cuDNN rounds the factors to 11 bits (TF32).

    A variance computed as the mean of squares minus the square of the mean does not survive that. The setting belongs
    to the process and is restored at the end.
    """
    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    try:
        yield
    finally:
        torch.backends.cudnn.allow_tf32 = before
