"""The width of strands, chosen so that their coverage matches the hair masks (mattes) of the photographs best.

Strands drawn too thin reveal what lies behind them, and strands drawn too wide hide it; either way they learn wrong
colours. Around every protruding lock, the masks show how much light passes between strands. The taper towards the tips
is not estimated: strands slightly beside the true ones match mattes better the more they taper, whether or not the true
ones do.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch

from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View, Views
from neural_strands.model.compositing import drawn_share
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.lines import rasterise_lines

WIDTHS = tuple(1e-4 * 2 ** (step / 2) for step in range(-1, 7))
"""Widths tried first, metres: 0.07 to 0.8 mm."""
FINER = 2**0.25
"""The best of these is then refined by trying it divided and multiplied by this factor."""
VIEWS = 4
"""Number of views used."""


@torch.no_grad()
def estimate_width(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> float:
    """Choose the width with the least squared difference between coverage and hair masks.

    Args:
        model: provides the line resolution, the taper and the occluding body.
        strands: world metres.
        targets: photographs; those without a hair mask are not used.

    Returns:
        The width, metres; the model's own if there is no mask or no candidate matches better.
    """
    pick = torch.linspace(0, len(targets) - 1, min(VIEWS, len(targets))).round().long().tolist()
    asked = [targets[index] for index in pick]
    masked = [(target, target.hair_mask) for target in asked if target.hair_mask is not None]
    if not masked:
        return model.strand_width
    factor = model.config.supersample
    fine = [t.camera.resized(t.camera.width * factor, t.camera.height * factor) for t, _ in masked]
    hidden_by = [model.body.draw(camera).depth for camera in fine]

    def misfit(width: float) -> float:
        lines, total = replace(model.lines, width=width), 0.0
        for (_, mask), camera, depth in zip(masked, fine, hidden_by, strict=True):
            coverage = drawn_share(rasterise_lines(strands.points, camera, depth, lines, strands.t), factor)
            total += float((coverage - mask).square().mean())
        return total

    found = {width: misfit(width) for width in WIDTHS}
    best = min(found, key=lambda width: found[width])
    for width in (best / FINER, best * FINER, model.strand_width):
        found[width] = misfit(width)
    return min(found, key=lambda width: found[width])
