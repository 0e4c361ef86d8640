"""How large pictures may be while the camera moves, from how long the last ones took."""

import math

FIRST = 192
SMALLEST, LARGEST = 64, 640
"""Pixels along the longer side."""
STEP = 16
"""Sizes are multiples of this, so that they do not flicker."""


class Pace:
    """Sizes of pictures that take about `target` seconds each."""

    def __init__(self, target: float) -> None:
        self.target = target
        self._size = float(FIRST)

    @property
    def size(self) -> int:
        """Pixels along the longer side of the next picture."""
        return STEP * max(round(self._size / STEP), 1)

    def took(self, seconds: float) -> None:
        """Learn from a picture of `size`; halfway, because one picture says little."""
        wanted = self._size * math.sqrt(self.target / max(seconds, 1e-4))
        change = min(max(math.sqrt(wanted / self._size), 0.7), 1.3)
        self._size = min(max(self._size * change, SMALLEST), LARGEST)
