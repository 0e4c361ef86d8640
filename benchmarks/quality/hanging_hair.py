"""Hair that nobody has measured: it leaves the scalp, lies on the head and hangs, within the outline of the masks.

Its strands stand in for the line segments of the stereo in the ablation without stereo, so that a fit traces its first
strands through their flow.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.first_strands import hair_roots
from neural_strands.flow.hair_flow import hair_masks, hair_room, hanging_flow
from neural_strands.flow.hull import hair_hull
from neural_strands.flow.tracing import trace_strands
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.strands import directions
from neural_strands.geometry.views import Views
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.lmvs.region import find_region
from neural_strands.scalp.head import Head

EVERY = 2
"""One in this many points of the strands becomes a point of a segment."""


def hanging_segments(views: Views, head: Head, config: FitConfig) -> LineSegments:
    """Strands that hang, as segments from root to tip; nothing but cameras, masks and the head is used.

    Args:
        views: of which some have hair masks.
        head: mesh and chart in their frame.
        config: number of strands, the seed, and the settings of the initial strands.
    """
    initial = config.initial
    roots = hair_roots(head, config.strands, views, initial.hull, torch.Generator().manual_seed(config.seed))
    inside = _chains(hull_points(views, head, config)[:, None], torch.tensor([0.0, -1.0, 0.0]))
    room = hair_room(inside, views, head.mesh, roots.position, initial)
    flow = hanging_flow(room, inside, roots.position, roots.normal, initial)
    points = trace_strands(flow, roots.position, roots.normal, initial.trace)[:, ::EVERY]
    return _chains(points, directions(points))


def hull_points(views: Views, head: Head, config: FitConfig) -> Float[Tensor, "point 3"]:
    """Points spread evenly over the space that masks and head leave for hair."""
    index, hull = MeshIndex(head.mesh), config.initial.hull
    before = [HeadView.of(camera, index) for camera in views.cameras]
    found = [
        (view.camera, box) for view, mask in hair_masks(views, before) if (box := _box(mask > hull.mask_threshold))
    ]
    region = find_region([camera for camera, _ in found], [torch.tensor(box) for _, box in found])
    grid = region.grid(2 * config.initial.flow.spacing)
    return grid.nodes()[hair_hull(grid, hair_masks(views, before), head.mesh, hull) & region.holds(grid)]


def _box(hair: Bool[Tensor, "height width"]) -> list[float]:
    """Left, top, right and bottom of the hair, pixels; empty if there is none."""
    row, column = torch.nonzero(hair).T.tolist()
    return [float(edge) for edge in (min(column), min(row), max(column) + 1, max(row) + 1)] if row else []


def _chains(points: Float[Tensor, "chain point 3"], along: Tensor) -> LineSegments:
    """Chains of points that nobody doubts, with these directions."""
    chains, count, _ = points.shape
    flat = points.reshape(-1, 3)
    number = torch.arange(chains).repeat_interleave(count)
    return LineSegments(flat, along.expand_as(points).reshape(-1, 3).contiguous(), torch.ones(len(flat)), number)
