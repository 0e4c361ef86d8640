"""Room for the visible parts of strands, so that the host need not know their number before it queues a frame.

Their number, and that of the nodes around them, are the sizes of everything that follows in a frame. If a GPU had to
tell them, the host would wait in the middle of the frame, and the GPU then for further work. So a frame gets room for
some more than the last one had. When all of it is queued, the host looks whether that was enough, and if not, it
renders the frame again.
"""

from collections.abc import Callable

import torch

from neural_strands.model.outputs import RenderOutput
from neural_strands.raster.visible import Room

FIRST = (1.0, 0.5)
"""Parts and nodes for each pixel of the picture for which the first frame has room; dense hair that fills it has 0.8
parts."""
SPARE = 1.25
"""Room for a frame, in multiples of the parts of the one before: neighbouring views differ by some per cent."""
UNIT = 4096
"""The room is a multiple of this many parts."""


class PartRoom:
    """The room that frames of some hair get."""

    def __init__(self) -> None:
        self._per_pixel = FIRST

    def rendered(
        self, render: Callable[[Room | None], RenderOutput], pixels: int, device: torch.device
    ) -> RenderOutput:
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
        points, nodes = (0, 0) if frame.parts is None else frame.parts.read()
        self._per_pixel = (SPARE * points / pixels, SPARE * nodes / pixels)
        return frame if points <= room.points and nodes <= room.nodes else render(self._room(pixels))

    def _room(self, pixels: int) -> Room:
        return Room(*(max(-(-int(each * pixels) // UNIT), 1) * UNIT for each in self._per_pixel))
