"""One colour per strand, from the fitted appearance, for programs that cannot render it."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model.renderer import HairRenderer

VIEWS = 6
"""Cameras around the hair, at each of two heights."""
HEIGHTS = (0.1, 0.8)
"""Heights of these cameras above the hair's centre, radians."""
SIZE = (256, 256)
"""Size of their pictures, pixels."""
FARTHEST = 1.0
"""Distance between roots, metres, up to which a strand that no view sees takes its nearest neighbour's colour."""


def cameras_around(renderer: HairRenderer) -> list[Camera]:
    """Cameras that together see the hair from all sides."""
    points = renderer.strands.points
    return [camera for height in HEIGHTS for camera in turntable_cameras(points, VIEWS, SIZE, height)]


@torch.no_grad()
def strand_colours(renderer: HairRenderer, cameras: Sequence[Camera]) -> Float[Tensor, "strand 3"]:
    """Linear RGB of each strand: the median, over the views that see it, of the mean of its rendered pixels.

    A strand that no view sees takes the colour of the nearest seen one; mid grey if there is none.
    """
    strands, model = renderer.strands, renderer.model
    views = [_view_colours(renderer, camera) for camera in cameras]
    colours = torch.stack(views).nanmedian(dim=0).values
    seen = colours.isfinite().all(dim=1)
    if seen.any() and not seen.all():
        roots = strands.points[:, 0]
        _, index = nearest(roots[~seen], roots[seen], radius=FARTHEST)
        colours[~seen] = colours[seen][index.clamp(min=0)]
    return colours.nan_to_num(nan=0.5).to(model.root_uv.device)


def _view_colours(renderer: HairRenderer, camera: Camera) -> Float[Tensor, "strand 3"]:
    """Mean colour of the pixels that show each strand in one view; NaN where none does."""
    hair, strands = renderer.render_hair(camera), renderer.strands
    visible = hair.visible
    light = hair.rgb.clamp(0, 1).reshape(-1, 3)[visible.pixel] * visible.weight[:, None]
    total = light.new_zeros(len(strands), 3).index_add_(0, visible.strand, light)
    return total / total.new_zeros(len(strands)).index_add_(0, visible.strand, visible.weight)[:, None]
