"""Plots by matplotlib without a display: curves, small drawings of strands, scalp charts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from torch import Tensor

DPI = 110
"""Resolution of plots, pixels per inch of the figure."""
COLOURS = ("#222222", "#d1495b", "#2e86ab", "#66a182")
"""Colours of the strands in a panel, the true one first."""


@dataclass(frozen=True)
class Panel:
    """A small drawing of several strands on top of each other.

    Attributes:
        strands: drawn in the order of `COLOURS`.
        title: text above the panel.
    """

    strands: Sequence[Float[Tensor, "point 3"]]
    title: str = ""


def curves_plot(series: Mapping[str, Sequence[tuple[float, float]]], title: str) -> Float[Tensor, "height width 3"]:
    """Loss curves over steps on a logarithmic axis; values that are not positive are left out."""
    figure = Figure(figsize=(7, 3.2), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    for name, points in series.items():
        shown = [(x, y) for x, y in points if y > 0]
        if shown:
            axes.plot(*zip(*shown, strict=True), label=name, linewidth=1.2)
    axes.set_yscale("log")
    axes.set_xlabel("step")
    axes.set_title(title)
    axes.grid(alpha=0.3)
    # Beside the curves, which it would hide.
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    return figure_image(figure)


def panels_plot(
    rows: Sequence[Sequence[Panel]], labels: Sequence[str] = (), legend: str = ""
) -> Float[Tensor, "height width 3"]:
    """Panels in a grid: strands in the plane in which they are widest, centimetres; one label per row, if any."""
    columns = max(len(row) for row in rows)
    figure = Figure(figsize=(1.9 * columns + 1.0, 1.9 * len(rows) + 0.4), dpi=DPI, layout="constrained")
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
    return figure_image(figure)


def chart_plot(faces: Float[Tensor, "face 3 2"], roots: Float[Tensor, "root 2"]) -> Float[Tensor, "height width 3"]:
    """Faces of a scalp chart and roots on it, texture coordinates in [0, 1]."""
    figure = Figure(figsize=(8, 8), dpi=DPI)
    axes = figure.add_axes((0.09, 0.07, 0.9, 0.9))
    polygons = PolyCollection(list(faces.numpy()), facecolor="#dfe7f0", edgecolor="#8899aa", linewidth=0.4)
    axes.add_collection(polygons)
    axes.scatter(*roots.T.numpy(), s=3, color="#b04a2f")
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="u (right)", ylabel="v (towards the nape)", aspect="equal")
    return figure_image(figure)


def figure_image(figure: Figure) -> Float[Tensor, "height width 3"]:
    """A figure's pixels, sRGB in [0, 1]."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return torch.from_numpy(np.array(canvas.buffer_rgba())[..., :3]).float() / 255


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
    moved = [strand.detach().cpu().double() for strand in strands]
    return [100 * torch.stack([strand[:, :2] @ across, strand[:, 2]], dim=1).numpy() for strand in moved]
