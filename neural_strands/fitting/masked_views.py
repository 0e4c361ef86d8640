"""Cameras with their hair masks, read one view at a time."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.geometry.cameras import Camera


@dataclass(frozen=True)
class MaskedViews:
    """The views of a capture that have a hair mask.

    Attributes:
        capture: where masks are read.
        indices: the views with a mask.
        device: where cameras and masks are put.
    """

    capture: Capture
    indices: tuple[int, ...]
    device: torch.device

    @classmethod
    def of(cls, capture: Capture, device: torch.device) -> "MaskedViews":
        """Find the views with a mask; no mask is read."""
        indices = tuple(index for index, view in enumerate(capture.views) if view.hair_mask_path is not None)
        return cls(capture, indices, device)

    @property
    def masked(self) -> bool:
        """Whether there is any mask."""
        return bool(self.indices)

    def __iter__(self) -> Iterator[tuple[Camera, Float[Tensor, "height width"]]]:
        """Camera and hair coverage of each view."""
        for index in self.indices:
            mask = self.capture.hair_mask(index, self.device)
            if mask is not None:
                yield self.capture.cameras[index].to(self.device), mask
