"""Segments and points of the strands that are visible in the photographs."""

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.lines import rasterise_lines


@torch.no_grad()
def front_segments(
    model: HairModel,
    strands: Float[Tensor, "strand point 3"],
    camera: Camera,
    body: Float[Tensor, "height width"] | None = None,
) -> Int64[Tensor, "height width"]:
    """The frontmost segment at each pixel (`raster.lines.LineBuffer.segment`), -1 where body or nothing is in front.

    Args:
        model: provides the body, which hides what is behind it.
        strands: world metres; drawn one pixel wide.
        camera: camera of the view.
        body: depth of the body in this view, if the caller has it already.
    """
    if body is None:
        body = model.body.draw(camera).depth
    return rasterise_lines(strands, camera, body, replace(model.lines, width=0.0)).segment


@torch.no_grad()
def seen_points(
    model: HairModel, strands: Float[Tensor, "strand point 3"], cameras: Sequence[Camera]
) -> Bool[Tensor, "strand point"]:
    """Mark the points that end a segment which is frontmost in some pixel of some view.

    Args:
        model: provides the body, which hides what is behind it.
        strands: world metres.
        cameras: cameras of the views.
    """
    count, points = strands.shape[:2]
    nothing = count * (points - 1)
    front = torch.zeros(nothing + 1, dtype=torch.bool, device=strands.device)
    for camera in cameras:
        segment = front_segments(model, strands, camera)
        front.index_fill_(0, torch.where(segment >= 0, segment, nothing).reshape(-1), True)
    between = front[:-1].reshape(count, points - 1)
    return torch.nn.functional.pad(between, (1, 0)) | torch.nn.functional.pad(between, (0, 1))
