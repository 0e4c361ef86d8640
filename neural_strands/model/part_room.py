"""Room for the visible parts of strands, so that the host need not know their number before it queues a frame.

Their number is the size of everything that follows in a frame. If a GPU had to tell it, the host would wait in the
middle of the frame, and the GPU then for further work. So a frame gets room for some more parts than the last one had.
When all of it is queued, the host looks whether that was enough, and if not, it renders the frame again.
"""

from collections.abc import Callable

import torch

from neural_strands.model.outputs import RenderOutput

FIRST = 1.0
"""Parts for each pixel of the picture for which the first frame has room; dense hair that fills it has 0.8."""
SPARE = 1.25
"""Room for a frame, in multiples of the parts of the one before: neighbouring views differ by some per cent."""
UNIT = 4096
"""The room is a multiple of this many parts."""


class PartRoom:
    """The room that frames of some hair get."""

    def __init__(self) -> None:
        self._per_pixel = FIRST

    def rendered(self, render: Callable[[int | None], RenderOutput], pixels: int, device: torch.device) -> RenderOutput:
        """Render a frame.

        Args:
            render: renders it with room for so many parts, or for as many as there are.
            pixels: number of pixels of the picture.
            device: where it is rendered; a CPU always knows how many there are.
        """
        if device.type == "cpu":
            return render(None)
        room = self._room(pixels)
        frame = render(room)
        found = 0 if frame.parts is None else frame.parts.read()
        self._per_pixel = SPARE * found / pixels
        return frame if found <= room else render(self._room(pixels))

    def _room(self, pixels: int) -> int:
        return max(-(-int(self._per_pixel * pixels) // UNIT), 1) * UNIT
