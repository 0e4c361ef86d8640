"""Hair and the skin beneath it: strands neither grow into the scalp nor run into a body that the hair lies on.

Segments show the outermost hair. On long hair that lies on shoulders and back they run along the body, but directions
diffused beneath them lead the hidden hair straight down into it, where it would end. So no hair enters a body that
segments run along. Hair whose segments run into the body ends there: that of artists' grooms passes through shoulders.
"""

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.field import FlowField
from neural_strands.flow.unseen import HeadLayer, marked
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.voxel_grid import VoxelGrid

SKIN = 0.008
"""Distance from the skin up to which directions into it are turned along it, metres."""
ON_BODY = 0.01
"""Distance from the body within which segments lie on it, metres."""
FROM_SCALP = 0.06
"""Distance from the scalp beyond which skin is the body's, metres."""
INTO = 0.5
"""Segments run into the body if the cosine between them and its inward normal exceeds this."""
LEAST_SHARE, MOST_INTO = 0.02, 0.1
"""Hair lies on the body if this share of its segments do, and at most this share of those run into it."""
INSIDE = 0.002
"""Voxels nearer to the skin than this belong to the body, unless they hold hair, metres."""


def lies_on_body(segments: LineSegments, scalp_points: Float[Tensor, "root 3"], layer: HeadLayer) -> bool:
    """Whether a fair part of the hair lies on shoulders, neck or back and runs along them.

    Args:
        segments: confident line segments, signed from root to tip.
        scalp_points: roots on the scalp, metres.
        layer: distances to the head around it.
    """
    if len(segments) == 0:
        return False
    height, outward, _ = layer.at(segments.points)
    to_scalp, _ = nearest(segments.points, scalp_points, radius=FROM_SCALP)
    lying = (height < ON_BODY) & ~to_scalp.isfinite()
    into = -(segments.directions * outward).sum(dim=-1)[lying] > INTO
    return len(into) > LEAST_SHARE * len(lying) and float(into.float().mean()) <= MOST_INTO


def body_voxels(grid: VoxelGrid, domain: Bool[Tensor, "x y z"], layer: HeadLayer) -> Bool[Tensor, "x y z"]:
    """Voxels of the head and the body, scalp included, that hold no hair."""
    return (layer.heights(grid) < INSIDE) & ~domain


def near_scalp(field: FlowField, scalp_points: Float[Tensor, "root 3"]) -> Bool[Tensor, "x y z"]:
    """Voxels within `SKIN` of a root that lies in the hair."""
    reach = round(SKIN / field.grid.spacing)
    index, inside = field.grid.index(scalp_points)
    rooted = marked(field.domain, index[inside]).to(field.directions)[None, None]
    return functional.max_pool3d(rooted, 2 * reach + 1, stride=1, padding=reach)[0, 0] > 0


def along_skin(field: FlowField, where: Bool[Tensor, "x y z"], layer: HeadLayer) -> FlowField:
    """Turn directions that lead into the skin along it: on the skin completely, less above.

    Args:
        field: growth directions.
        where: voxels in which to turn them, if they hold hair.
        layer: distances to the head around it.
    """
    voxels = torch.nonzero((field.domain & where).reshape(-1)).squeeze(1)
    height, outward, _ = layer.at(field.grid.nodes(field.domain.device).reshape(-1, 3)[voxels])
    given = field.directions.reshape(-1, 3)[voxels]
    into = (given * outward).sum(dim=-1, keepdim=True).clamp(max=0)
    turned = functional.normalize(given - (1 - height / SKIN).clamp(0, 1)[:, None] * into * outward, dim=-1)
    directions = field.directions.reshape(-1, 3).index_copy(0, voxels, turned)
    return replace(field, directions=directions.reshape_as(field.directions))
