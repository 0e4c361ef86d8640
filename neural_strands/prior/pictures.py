"""Pictures of strands for reports, drawn with matplotlib; no display is needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.files import atomic_file

COLOURS = ("#222222", "#d1495b", "#2e86ab", "#66a182")
"""Colours of the strands in a panel; the true strand comes first."""


@dataclass(frozen=True)
class Panel:
    """A small drawing of superimposed strands.

    Attributes:
        strands: drawn in the order of `COLOURS`.
        title: above the panel.
    """

    strands: Sequence[Float[Tensor, "point 3"]]
    title: str = ""


def draw_panels(path: Path, rows: Sequence[Sequence[Panel]], labels: Sequence[str] = (), legend: str = "") -> None:
    """Write panels as a grid, each strand in centimetres in the plane in which it is widest.

    Raises:
        InputError: the picture cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(1.9 * columns + 1.0, 1.9 * len(rows) + 0.4), layout="constrained")
    grid: Any = figure.subplots(len(rows), columns, squeeze=False)
    for number, row in enumerate(rows):
        for column in range(columns):
            axes = grid[number][column]
            if column >= len(row):
                axes.set_axis_off()
                continue
            _draw(axes, row[column])
        if labels:
            grid[number][0].set_ylabel(labels[number], fontsize=7)
    if legend:
        figure.suptitle(legend, fontsize=9)
    with atomic_file(path) as temporary:
        FigureCanvasAgg(figure).print_figure(temporary, dpi=110)


def _draw(axes: Any, panel: Panel) -> None:
    flat = _flatten(panel.strands)
    for index, (strand, colour) in enumerate(zip(flat, COLOURS, strict=False)):
        axes.plot(strand[:, 0], strand[:, 1], color=colour, linewidth=1.6 if index == 0 else 0.9)
    axes.plot(*flat[0][0], "o", color=COLOURS[0], markersize=2.5)
    axes.set_aspect("equal", "datalim")
    axes.tick_params(labelsize=5, length=2)
    axes.set_title(panel.title, fontsize=6)


def _flatten(strands: Sequence[Float[Tensor, "point 3"]]) -> list[np.ndarray]:
    """Project onto the normal and the widest horizontal direction of the first strand, in centimetres."""
    first = strands[0].detach().cpu().double()
    across = torch.linalg.svd(first[:, :2] - first[:, :2].mean(dim=0), full_matrices=False)[2][0]
    return [
        100 * torch.stack([s.detach().cpu().double()[:, :2] @ across, s.detach().cpu().double()[:, 2]], dim=1).numpy()
        for s in strands
    ]
