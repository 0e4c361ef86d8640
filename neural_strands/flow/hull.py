"""Where hair can be: the volume outside the head that no view shows to be empty."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.geometry.visual_hull import HeadView, Silhouette, possible_points, visual_hull
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.raster.dilation import widen


@dataclass(frozen=True)
class HullConfig:
    """How strictly a view declares voxels empty."""

    mask_threshold: Annotated[float, Between(0, 1)] = 0.2
    """A pixel whose hair coverage is below this, with all its neighbours, shows no hair."""
    mask_margin: Annotated[float, Between(0, 1)] = 0.0015
    """Metres by which the masks are widened, for calibration errors and stray hairs."""
    head_depth: Annotated[float, Between(0, 1)] = 0.002
    """Metres below the head's surface at which hair is impossible."""


def hair_hull(
    grid: VoxelGrid,
    views: Iterable[tuple[HeadView, Float[Tensor, "height width"]]],
    head: Mesh,
    config: HullConfig | None = None,
    distance: SignedDistanceGrid | None = None,
    witnesses: int = 1,
) -> Bool[Tensor, "x y z"]:
    """Carve the grid by the hair masks of all views; the head hides what is behind it.

    Args:
        grid: the voxels to classify.
        views: each view with its hair coverage in [0, 1], read one at a time.
        head: the head mesh; voxels inside it are not hair.
        config: tolerances.
        distance: sampled distance to the head, if the caller has it already; only saves time.
        witnesses: number of views that have to show a voxel to be empty.
    """
    config = config or HullConfig()
    nodes = grid.nodes(head.vertices.device)
    silhouettes = _silhouettes(views, nodes.mean(dim=(0, 1, 2)), config)
    everywhere = torch.ones(grid.shape, dtype=torch.bool, device=nodes.device)
    possible = visual_hull(grid, silhouettes, everywhere, witnesses)
    possible[possible.clone()] = _outside_head(nodes[possible], head, distance, config.head_depth)
    return possible


def hairy_points(
    points: Float[Tensor, "point 3"],
    views: Iterable[tuple[HeadView, Float[Tensor, "height width"]]],
    config: HullConfig | None = None,
    witnesses: int = 1,
) -> Bool[Tensor, " point"]:
    """Mark points that too few views show to be bare; the head hides what is behind it.

    Args:
        points: world metres, slightly above the head: on its surface, the head might hide them from every view.
        views: each view with its hair coverage in [0, 1], read one at a time.
        config: tolerances.
        witnesses: number of views that have to show a point to be bare.
    """
    return possible_points(points, _silhouettes(views, points.mean(dim=0), config or HullConfig()), witnesses)


def _silhouettes(
    views: Iterable[tuple[HeadView, Float[Tensor, "height width"]]], middle: Float[Tensor, "3"], config: HullConfig
) -> Iterator[Silhouette]:
    """Where each view may show hair: its mask, widened by `mask_margin` at the distance of the hair's middle."""
    for view, mask in views:
        footprint = view.camera.footprint(float((view.camera.position - middle).norm()))
        covered = widen(mask, round(config.mask_margin / footprint)) >= config.mask_threshold
        yield Silhouette(view, covered)


def covered_volume(
    grid: VoxelGrid,
    points: Float[Tensor, "point 3"],
    head: Mesh,
    config: HullConfig | None = None,
    distance: SignedDistanceGrid | None = None,
) -> Bool[Tensor, "x y z"]:
    """The volume between the head and the given points on the hair, for captures without masks.

    Every voxel between a point and the closest point of the head may hold hair.
    """
    config = config or HullConfig()
    foot = closest_points(points, head).position
    steps = int(((points - foot).norm(dim=-1).max() / grid.spacing).ceil()) + 1 if len(points) else 0
    filled = torch.zeros(grid.count, dtype=torch.bool, device=points.device)
    for fraction in torch.linspace(0.0, 1.0, 2 * steps).tolist():
        index, inside = grid.index(foot + fraction * (points - foot))
        filled[index[inside]] = True
    volume = filled.reshape(grid.shape)
    grown = torch.nn.functional.max_pool3d(volume[None, None].float(), 3, stride=1, padding=1)[0, 0] > 0
    nodes = grid.nodes(head.vertices.device)
    grown[grown.clone()] = _outside_head(nodes[grown], head, distance, config.head_depth)
    return grown


def _outside_head(
    points: Float[Tensor, "point 3"], head: Mesh, distance: SignedDistanceGrid | None, depth: float
) -> Bool[Tensor, " point"]:
    """Mark points that lie no deeper than `depth` metres below the head's surface."""
    if distance is not None:
        return distance.is_above(points, depth, head)
    return signed_distance(points, head).distance > -depth
