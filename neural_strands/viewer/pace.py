"""Chooses the size of pictures while the camera moves, from the time that the last ones took."""

import math

FIRST = 192
SMALLEST, LARGEST = 96, 640
"""Bounds of the longer side, pixels."""
STEP = 16
"""Sizes are multiples of this, so that they do not flicker."""


class Pace:
    """Chooses sizes of pictures that take about `target` seconds each."""

    def __init__(self, target: float) -> None:
        self.target = target
        self._size = float(FIRST)

    @property
    def size(self) -> int:
        """Longer side of the next picture, pixels."""
        return STEP * max(round(self._size / STEP), 1)

    def took(self, seconds: float) -> None:
        """Adapt to the time of a picture of the present size; only halfway, because single times are noisy."""
        wanted = self._size * math.sqrt(self.target / max(seconds, 1e-4))
        change = min(max(math.sqrt(wanted / self._size), 0.7), 1.3)
        self._size = min(max(self._size * change, SMALLEST), LARGEST)
