"""Smoothstep, the cubic that rises from 0 to 1 with horizontal tangents at both ends."""

from typing import TypeVar

from torch import Tensor

Share = TypeVar("Share", float, Tensor)


def smoothstep(share: Share) -> Share:
    """3 s^2 - 2 s^3 of a share s, which is first limited to [0, 1]: 0 up to 0, 1 from 1, smooth in between."""
    part = share.clamp(0, 1) if isinstance(share, Tensor) else min(max(share, 0.0), 1.0)
    return part * part * (3 - 2 * part)
