"""The progress of a fit, and its loss curves."""

from typing import TYPE_CHECKING

import numpy as np

from neural_strands.runs.run_folder import RunFolder, read_description
from neural_strands.runs.run_log import loss_label, read_losses

if TYPE_CHECKING:
    import viser

FIRST_SHOWN = "render"
"""The curve that is selected first, once it exists: the squared colour error."""
PADDING = (14, 14, 0, 0)
"""Space above, right, below and left of the chart, for the outermost numbers on its axes, pixels."""


class FitPanel:
    """Number of steps done, and the curve of one loss."""

    def __init__(self, server: "viser.ViserServer", folder: RunFolder) -> None:
        """Add the controls; `update` fills them.

        Raises:
            InputError: the run's description is damaged.
        """
        gui = server.gui
        self._folder = folder
        self._steps = read_description(folder).config.steps
        self._read = 0
        self._series: dict[str, list[tuple[float, float]]] = {}
        self._done = gui.add_markdown("")
        self._bar = gui.add_progress_bar(0.0)
        self._choice = gui.add_dropdown("Curve", (loss_label(FIRST_SHOWN),))
        nothing = np.zeros(0)
        self._chart = gui.add_uplot(
            (nothing, nothing),
            ({"label": "step"}, {"label": "loss", "stroke": "#2b6cb0", "width": 1.5}),
            scales={"x": {"time": False}},
            aspect=1.4,
            padding=PADDING,
        )
        self._choice.on_update(lambda _: self._draw())
        self.update()

    def update(self) -> None:
        """Show the new contents of the log, if it has grown.

        Raises:
            InputError: the log cannot be read.
        """
        size = self._folder.log.stat().st_size if self._folder.log.is_file() else 0
        if size == self._read and size:
            return
        self._read = size
        self._series = read_losses(self._folder.log)
        done = max((curve[-1][0] for curve in self._series.values()), default=0.0)
        self._done.content = f"**Step {done:.0f} of {self._steps}**"
        self._bar.value = 100.0 * min(done / self._steps, 1.0)
        names = tuple(loss_label(name) for name in self._series)
        if names and names != self._choice.options:
            chosen = self._choice.value
            self._choice.options = names
            self._choice.value = chosen if chosen in names else names[0]
        self._draw()

    def _draw(self) -> None:
        curve = next((curve for name, curve in self._series.items() if loss_label(name) == self._choice.value), [])
        steps, values = np.array(curve, np.float64).reshape(-1, 2).T
        self._chart.data = (steps, values)
