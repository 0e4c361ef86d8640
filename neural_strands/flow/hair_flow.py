"""The flow of a person's hair: where hair can be, and the growth directions there."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.body import along_skin, body_voxels, lies_on_body, near_scalp
from neural_strands.flow.conservation import ConservationConfig, conserve
from neural_strands.flow.curls import CurlConfig
from neural_strands.flow.field import FlowConfig, FlowField, diffuse_directions, grid_around
from neural_strands.flow.hull import HullConfig, covered_volume, hair_hull
from neural_strands.flow.rolling_ball import BallConfig, behind_ball, crowded
from neural_strands.flow.tracing import TraceConfig
from neural_strands.flow.unseen import (
    HeadLayer,
    OverHead,
    UnseenConfig,
    UnseenHair,
    bare_skin,
    climbing,
    guess_unseen,
    hair_extent,
    head_layer,
    lying_directions,
    marked,
)
from neural_strands.foundation.configs import Between
from neural_strands.foundation.progress import Track, untracked
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.views import Views
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.geometry.voxel_grid import VoxelGrid

VOXEL_BYTES = 180
"""Peak memory of `hair_room` and `hair_flow`, bytes per voxel of their grid (152 and 181 measured)."""


@dataclass(frozen=True)
class InitialConfig:
    """Settings of the initial strands."""

    flow: FlowConfig = field(default_factory=FlowConfig)
    """The volume of growth directions."""
    conservation: ConservationConfig = field(default_factory=ConservationConfig)
    """How the flow is made to conserve the number of strands."""
    hull: HullConfig = field(default_factory=HullConfig)
    """Where hair can be."""
    ball: BallConfig = field(default_factory=BallConfig)
    """Which room that masks leave is empty, to judge by the segments."""
    unseen: UnseenConfig = field(default_factory=UnseenConfig)
    """How hair that no view sees is continued from what is seen."""
    trace: TraceConfig = field(default_factory=TraceConfig)
    """Streamlines from the scalp."""
    seen_share: Annotated[float, Between(0, 1)] = 0.25
    """Share of the strands that start where hair begins that the photographs show (see `seen_roots`); the others are
    spread evenly over the scalp."""
    curls: CurlConfig = field(default_factory=CurlConfig)
    """When hair counts as curly, and how curls are laid about their axes."""


@dataclass(frozen=True)
class HairRoom:
    """Where hair can be.

    Attributes:
        grid: the voxels.
        domain: voxels that no view shows to be empty.
        layer: a coarse grid around the head, and its visibility.
        head: mesh of the head.
        masked: whether the domain was carved by hair masks.
    """

    grid: VoxelGrid
    domain: Bool[Tensor, "x y z"]
    layer: HeadLayer
    head: Mesh
    masked: bool

    def inset(self, depth: float) -> "HairRoom":
        """The room of the axes of curls: all places deeper than `depth` metres in the hair or nearer to the head."""
        height = self.layer.heights(self.grid)
        reach = round(depth / self.grid.spacing)
        air = functional.pad((~self.domain & (height > 0)).float(), (reach,) * 6, value=1.0)
        near = functional.max_pool3d(air[None, None], 2 * reach + 1, stride=1)[0, 0] > 0
        return replace(self, domain=self.domain & (~near | (height < depth)))


def flow_memory(points: Float[Tensor, "point 3"], config: FlowConfig) -> int:
    """Peak memory of `hair_room` and `hair_flow` for hair and roots at these points, bytes."""
    return VOXEL_BYTES * grid_around(points, config.spacing, config.margin).count


def hair_room(
    segments: LineSegments,
    views: Views,
    head: Mesh,
    scalp_points: Float[Tensor, "root 3"],
    config: InitialConfig,
    distance: SignedDistanceGrid | None = None,
    track: Track = untracked,
) -> HairRoom:
    """Find where hair can be, from masks where there are any, otherwise from segments.

    Args:
        segments: line segments of the hair.
        views: the views, with or without hair masks.
        head: mesh of the head.
        scalp_points: roots on its scalp.
        config: settings of the initial strands.
        distance: signed distance to the head, if the caller has sampled it already; only saves time.
        track: shows the progress of the masks.
    """
    known = torch.cat([segments.points, scalp_points])
    grid = grid_around(known, config.flow.spacing, config.flow.margin)
    index = MeshIndex(head)
    before = [HeadView.of(camera, index) for camera in views.cameras]
    masked = any(views.has_hair_mask)
    if masked:
        masks = track(hair_masks(views, before), "carving the room of the hair", sum(views.has_hair_mask))
        domain = hair_hull(grid, masks, head, config.hull, distance, views.witnesses)
    else:
        domain = covered_volume(grid, segments.points, head, config.hull, distance)
    return HairRoom(grid, domain, head_layer(grid, before, head, config.unseen), head, masked)


def hair_masks(views: Views, before: Sequence[HeadView]) -> Iterator[tuple[HeadView, Float[Tensor, "height width"]]]:
    """The views that have a hair mask, each with the depth of the head in it."""
    for index, view in enumerate(before):
        mask = views.hair_mask(index) if views.has_hair_mask[index] else None
        if mask is not None:
            yield view, mask


def hair_flow(
    room: HairRoom,
    segments: LineSegments,
    scalp_points: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    config: InitialConfig,
    track: Track = untracked,
) -> FlowField:
    """Estimate the directions of the hair from segments, the scalp and the room that hair fills.

    Args:
        room: where hair can be.
        segments: line segments, signed from root to tip.
        scalp_points: roots on the scalp.
        scalp_normals: its outward unit normals there.
        config: settings of the initial strands.
        track: shows the progress of sweeps and rounds.
    """
    domain, guess = guess_unseen(room.layer, room.grid, room.domain, segments, room.head, room.masked, config.unseen)
    if room.masked:
        domain = domain & (marked(domain, guess.voxels) | behind_segments(room, segments, config))
    smooth = diffuse_directions(room.grid, domain, segments, scalp_points, scalp_normals, config.flow, guess, track)
    confident = segments.select(segments.confidence >= config.flow.least_confidence)
    if lies_on_body(confident, scalp_points, room.layer):
        walls, turned = body_voxels(room.grid, domain, room.layer), domain
        smooth = along_skin(smooth, domain, room.layer)
    else:
        # Strands that meet the shoulders end there.
        walls, turned = None, near_scalp(smooth, scalp_points)
    full = conserve(smooth, scalp_points, scalp_normals, config.hull.head_depth, config.conservation, walls, track)
    return along_skin(full, turned, room.layer)


def behind_segments(room: HairRoom, segments: LineSegments, config: InitialConfig) -> Bool[Tensor, "x y z"]:
    """Places that a ball rolling about the head and the confident segments cannot reach (see `rolling_ball`)."""
    grid, kept = room.grid, segments.confidence >= config.flow.least_confidence
    hair = crowded(grid, segments.points[kept], config.ball.least_points)
    return behind_ball(grid, hair | (room.layer.heights(grid) < grid.spacing), config.ball)


def hanging_flow(
    room: HairRoom,
    segments: LineSegments,
    scalp_points: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    config: InitialConfig,
    track: Track = untracked,
) -> FlowField:
    """The flow of hair that leaves the scalp, lies on the head, falls under gravity and fills its room.

    It needs no segments' directions, so it tells how hair runs on the whole where segments follow its curls.

    Args:
        room: where hair can be, carved by masks.
        segments: line segments of the hair; only their places count, as hair that views see.
        scalp_points: roots on the scalp.
        scalp_normals: its outward unit normals there.
        config: settings of the initial strands.
        track: shows the progress of sweeps and rounds.
    """
    grid, layer, unseen = room.grid, room.layer, config.unseen
    domain, _ = guess_unseen(layer, grid, room.domain, segments, room.head, room.masked, unseen)
    bare = bare_skin(layer, grid, room.domain, room.head)
    thickness = hair_extent(layer, grid, room.domain, bare, unseen.sweeps)[..., :1]
    everywhere = replace(layer, unseen=torch.ones_like(layer.unseen))
    directions = lying_directions(everywhere, scalp_points, scalp_normals, thickness[..., 0], unseen)
    voxels = torch.nonzero(domain.reshape(-1)).squeeze(1)
    places = grid.nodes(domain.device).reshape(-1, 3)[voxels]
    distance, outward, _ = layer.at(places)
    rise = climbing(layer.grid.sample(thickness, places, outside="border")[:, 0], distance, unseen)
    lying = layer.grid.sample(directions, places, outside="border")
    guess = UnseenHair(voxels, OverHead(outward, distance, rise), lying)
    smooth = diffuse_directions(
        grid, domain, segments.select(torch.arange(0)), scalp_points, scalp_normals, config.flow, guess, track
    )
    depth = config.hull.head_depth
    return conserve(smooth, scalp_points, scalp_normals, depth, config.conservation, track=track)
