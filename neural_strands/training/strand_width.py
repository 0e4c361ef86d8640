"""How wide strands are drawn: the width whose coverage is most like the photographs' mattes.

Strands drawn too thin let what lies behind them show, too wide they hide it; either way the colours that images teach
them are wrong. Masks know better: round every lock that stands off, they tell how much light passes between strands.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch

from neural_strands.geometry.strands import Strands
from neural_strands.model.compositing import area_mean
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.training.observation import Observation

WIDTHS = tuple(1e-4 * 2 ** (step / 2) for step in range(-1, 7))
"""Widths that are tried, metres: 0.07 to 0.8 mm."""
TIPS = (0.0, 0.33, 0.66)
"""Shares of the strands that are tried to thin out; the middle one with every width."""
VIEWS = 4
"""Views that are asked."""


@torch.no_grad()
def estimate_width(model: HairModel, strands: Strands, targets: Sequence[Observation]) -> LineConfig:
    """Choose width and tip by the squared difference between coverage and hair masks.

    Args:
        model: says how finely lines are drawn, and what hides them.
        strands: world metres.
        targets: photographs; those without a mask are not asked.

    Returns:
        How to draw strands; as the model does now where there is no mask, or none of the widths does better.
    """
    pick = torch.linspace(0, len(targets) - 1, min(VIEWS, len(targets))).round().long().tolist()
    masked = [(target, target.mask) for target in (targets[index] for index in pick) if target.mask is not None]
    if not masked:
        return model.lines
    factor = model.config.supersample
    fine = [t.camera.resized(t.camera.width * factor, t.camera.height * factor) for t, _ in masked]
    hidden_by = [model.body(camera).depth for camera in fine]

    def misfit(lines: LineConfig) -> float:
        total = 0.0
        for (_, mask), camera, depth in zip(masked, fine, hidden_by, strict=True):
            drawn = rasterise_lines(strands.points, camera, depth, lines).segment >= 0
            coverage = area_mean(drawn[..., None].to(depth.dtype), factor)[..., 0]
            total += float((coverage - mask).square().mean())
        return total

    found = {(width, TIPS[1]): misfit(replace(model.lines, width=width, tip=TIPS[1])) for width in WIDTHS}

    def best() -> tuple[float, float]:
        return min(found, key=lambda pair: found[pair])

    place = WIDTHS.index(best()[0])
    for width in WIDTHS[max(place - 1, 0) : place + 2]:
        for tip in (TIPS[0], TIPS[2]):
            found[width, tip] = misfit(replace(model.lines, width=width, tip=tip))
    width, tip = best()
    for finer in (width * 2**-0.25, width * 2**0.25):
        found[finer, tip] = misfit(replace(model.lines, width=finer, tip=tip))
    width, tip = best()
    if misfit(model.lines) <= found[width, tip]:
        return model.lines
    return replace(model.lines, width=width, tip=tip)
