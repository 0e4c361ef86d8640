"""Hair that no view sees: how far it reaches, how it lies, and how long it is.

The visual hull is open at the back: what the head hides from every view is never carved, and no segments guide the flow
there. So the seen hair is extrapolated over the head: its thickness (zero over bare skin) and its directions are
extended harmonically, by Laplace's equation on a coarse grid in the layer around the head. Directions there follow the
head's surface, and increasingly gravity with the distance from seen hair.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.faces import face_neighbours, neighbour_mean
from neural_strands.flow.filling import average, pull_push
from neural_strands.foundation.configs import Between
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh, face_normals
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.visual_hull import HeadView, views_that_see
from neural_strands.geometry.voxel_grid import VoxelGrid

DOWN = (0.0, -1.0, 0.0)
"""Direction of gravity."""
HELD = 0.025
"""Distance from the head within which hair follows its surface, metres."""
SHARE_EVERY = 5
"""One in this many points of a strand is tested for visibility."""


@dataclass(frozen=True)
class UnseenConfig:
    """What counts as unseen, and how seen hair is extrapolated."""

    least_views: Annotated[int, Between(1, 1000)] = 2
    """Number of views that must see a place; a single view does not determine its depth."""
    facing: Annotated[float, Between(-1, 1)] = 0.2
    """A camera sees hair only if the cosine between the head's outward direction and the direction to it exceeds
    this."""
    lift: Annotated[float, Between(0, 1)] = 0.004
    """Height above the head at which visibility is tested, metres: points on the skin itself would be hidden by it."""
    spacing: Annotated[float, Between(1e-4, 1)] = 0.008
    """Spacing of the coarse grid, metres."""
    sweeps: Annotated[int, Between(0, 100_000)] = 300
    """Jacobi sweeps over the coarse grid after its multigrid start."""
    gravity_reach: Annotated[float, Between(1e-3, 1e3)] = 0.04
    """Distance from seen hair at which gravity counts as much as neighbouring hair, metres."""
    climb: Annotated[float, Between(1e-3, 1e3)] = 0.04
    """Length of strand over which it climbs two thirds of the way from the skin to the surface of the hair, metres."""
    steepest: Annotated[float, Between(0, 10)] = 0.35
    """Largest slope of that climb: hair that hangs far from the neck does not grow from the skin there."""


@dataclass(frozen=True)
class HeadLayer:
    """A coarse grid around the head, and its visibility.

    Attributes:
        grid: the coarse grid.
        distance: distance to the head's surface, metres, negative inside.
        outward: unit direction of increasing distance.
        unseen: 1 where too few views see the node, else 0.
    """

    grid: VoxelGrid
    distance: Float[Tensor, "x y z"]
    outward: Float[Tensor, "x y z 3"]
    unseen: Float[Tensor, "x y z"]

    def heights(self, fine: VoxelGrid) -> Float[Tensor, "x y z"]:
        """Distance to the head, interpolated at the nodes of another grid."""
        nodes = fine.nodes(self.distance.device).reshape(-1, 3)
        return self.grid.sample(self.distance[..., None], nodes, outside="border").view(fine.shape)

    def at(
        self, points: Float[Tensor, "point 3"]
    ) -> tuple[Float[Tensor, " point"], Float[Tensor, "point 3"], Bool[Tensor, " point"]]:
        """Distance, unit outward direction and whether unseen, interpolated at points in the grid."""
        volume = torch.cat([self.distance[..., None], self.outward, self.unseen[..., None]], dim=-1)
        read = self.grid.sample(volume, points, outside="border")
        return read[:, 0], functional.normalize(read[:, 1:4], dim=-1), read[:, 4] > 0.5


@dataclass(frozen=True)
class OverHead:
    """Places above the head, and how hair lies there.

    Attributes:
        outward: unit directions away from the head.
        distance: to the head's surface, metres.
        rise: slope at which hair climbs away from the head.
    """

    outward: Float[Tensor, "place 3"]
    distance: Float[Tensor, " place"]
    rise: Float[Tensor, " place"]

    def select(self, index: Tensor) -> "OverHead":
        """Some of the places."""
        return OverHead(self.outward[index], self.distance[index], self.rise[index])


@dataclass(frozen=True)
class UnseenHair:
    """Extrapolated hair that no view sees, in voxels of the fine grid.

    Attributes:
        voxels: ascending flat indices of voxels that no view sees and that hair may fill.
        place: their positions relative to the head.
        directions: growth directions, not normalised.
    """

    voxels: Int64[Tensor, " voxel"]
    place: OverHead
    directions: Float[Tensor, "voxel 3"]


def unseen_points(
    points: Float[Tensor, "point 3"],
    distance: Float[Tensor, " point"],
    outward: Float[Tensor, "point 3"],
    views: Iterable[HeadView],
    config: UnseenConfig | None = None,
) -> Bool[Tensor, " point"]:
    """Mark points that too few views see.

    Args:
        points: world metres.
        distance: distance of each to the head's surface, metres.
        outward: unit directions away from the head.
        views: cameras with the head before them, used one at a time.
        config: what counts as seen.
    """
    config = config or UnseenConfig()
    lifted = points + (config.lift - distance).clamp(min=0)[:, None] * outward
    return views_that_see(lifted, outward, views, config.facing) < config.least_views


def unseen_parts(
    points: Float[Tensor, "strand point 3"],
    views: Sequence[HeadView],
    head: SignedDistanceIndex,
    configs: Sequence[UnseenConfig],
) -> list[Bool[Tensor, "strand part"]]:
    """Mark which of every `SHARE_EVERY`-th point of strands, from the root on, too few views see.

    Args:
        points: strands, world metres.
        views: cameras with the head before them.
        head: index of distances to the head.
        configs: what counts as seen, once for each result.
    """
    some = points[:, ::SHARE_EVERY]
    flat = some.reshape(-1, 3)
    skin = head(flat)
    return [
        unseen_points(flat, skin.distance, skin.normal, views, config).reshape(some.shape[:2]) for config in configs
    ]


def guess_unseen(
    layer: HeadLayer,
    grid: VoxelGrid,
    domain: Bool[Tensor, "x y z"],
    segments: LineSegments,
    head: Mesh,
    masked: bool,
    config: UnseenConfig | None = None,
) -> tuple[Bool[Tensor, "x y z"], UnseenHair]:
    """Extrapolate the seen hair over the part of the head that no view sees.

    Args:
        layer: a coarse grid around the head, and its visibility.
        grid: the fine grid.
        domain: voxels that may be hair according to the views.
        segments: oriented points of hair.
        head: mesh of the head.
        masked: whether `domain` was carved by masks. If so, skin outside it is bare and unseen hair lies inside; if
            not, nothing is known outside.
        config: settings of the extrapolation.

    Returns:
        The domain with its unseen part bounded, and the extrapolated hair of that part.
    """
    config = config or UnseenConfig()
    bare = bare_skin(layer, grid, domain, head) if masked else segments.points[:0]
    extent = hair_extent(layer, grid, domain, bare, config.sweeps)
    directions = lying_directions(layer, segments.points, segments.directions, extent[..., 0], config)
    flat = domain.reshape(-1)
    voxels = torch.nonzero(flat if masked else torch.ones_like(flat)).squeeze(1)
    places = grid.nodes(domain.device).reshape(-1, 3)[voxels]
    distance, outward, unseen = layer.at(places)
    thickness, haired = layer.grid.sample(extent, places, outside="border").unbind(dim=1)
    outside = unseen & (distance > -grid.spacing)
    shell = outside & (haired > 0.5) & (distance <= thickness)
    if masked:
        shell = outside & hanging(marked(domain, voxels[shell])).reshape(-1)[voxels]
    # Masks leave everything that the head hides; segments are hair wherever they are.
    kept = flat.index_fill(0, voxels[unseen], False) if masked else flat
    bounded = kept.index_fill(0, voxels[shell], True).reshape(domain.shape)
    lying = layer.grid.sample(directions, places[shell], outside="border")
    place = OverHead(outward, distance, climbing(thickness, distance, config))
    guess = UnseenHair(voxels[shell], place.select(shell), lying)
    return bounded, guess


def hanging(hair: Bool[Tensor, "x y z"]) -> Bool[Tensor, "x y z"]:
    """The voxels of hair and all voxels below them: hair without support falls straight down."""
    return hair.flip(1).int().cummax(dim=1).values.flip(1) > 0


def marked(domain: Bool[Tensor, "x y z"], voxels: Int64[Tensor, " voxel"]) -> Bool[Tensor, "x y z"]:
    """A volume like the domain that is true in the voxels of these flat indices."""
    return torch.zeros_like(domain).reshape(-1).index_fill(0, voxels, True).reshape(domain.shape)


def head_layer(grid: VoxelGrid, views: Iterable[HeadView], head: Mesh, config: UnseenConfig) -> HeadLayer:
    """Distances to the head and visibility, on a coarse grid over the box of a fine one."""
    low = [first - 0.5 * grid.spacing for first in grid.origin]
    high = [start + size * grid.spacing for start, size in zip(low, grid.shape, strict=True)]
    coarse = VoxelGrid.filling(low, high, max(config.spacing, grid.spacing))
    nodes = coarse.nodes(head.vertices.device).reshape(-1, 3)
    skin = SignedDistanceIndex(head)(nodes)
    unseen = unseen_points(nodes, skin.distance, skin.normal, views, config)
    return HeadLayer(
        coarse,
        skin.distance.reshape(coarse.shape),
        skin.normal.reshape(*coarse.shape, 3),
        unseen.to(nodes).reshape(coarse.shape),
    )


def hair_extent(
    layer: HeadLayer, grid: VoxelGrid, domain: Bool[Tensor, "x y z"], bare: Float[Tensor, "point 3"], sweeps: int
) -> Float[Tensor, "i j k 2"]:
    """Thickness of the hair over the head, metres, and whether there is hair (from 0 to 1), at the nodes of the layer.

    Both are extended harmonically from where they are seen, but separately, so that hair is as thick at its edge as
    elsewhere.

    Args:
        layer: the coarse grid around the head.
        grid: the fine grid.
        domain: where there can be hair; its surface counts where views see it.
        bare: points over skin that views show to be bare.
        sweeps: number of Jacobi sweeps.
    """
    voxels = grid.nodes(domain.device)[domain]
    distance, outward, unseen = layer.at(voxels)
    beyond, inside = grid.index(voxels + 1.5 * grid.spacing * outward)
    surface = ~unseen & ~(inside & domain.reshape(-1)[beyond])
    hair, thickness = voxels[surface], (distance[surface] + 0.5 * grid.spacing).clamp(min=0)
    if len(hair) == 0:
        return torch.zeros(*layer.grid.shape, 2, device=domain.device)
    reach = layer.grid.spacing
    about = (layer.distance > -reach) & (layer.distance < float(thickness.max()) + reach)
    haired = torch.cat([torch.ones_like(thickness), bare.new_zeros(len(bare))])
    parts = []
    for places, values in ((hair, thickness), (torch.cat([hair, bare]), haired)):
        known, weight = average(layer.grid, places, values[:, None], torch.ones_like(values))
        parts.append(harmonic(known, weight > 0, about, sweeps))
    return torch.cat(parts, dim=-1)


def bare_skin(layer: HeadLayer, grid: VoxelGrid, domain: Bool[Tensor, "x y z"], head: Mesh) -> Float[Tensor, "point 3"]:
    """Points just above faces of the head that views see and where there can be no hair."""
    over = head.corners().mean(dim=1) + 1.5 * grid.spacing * face_normals(head)
    index, inside = grid.index(over)
    _, _, unseen = layer.at(over)
    return over[inside & ~unseen & ~domain.reshape(-1)[index]]


def lying_directions(
    layer: HeadLayer,
    points: Float[Tensor, "point 3"],
    directions: Float[Tensor, "point 3"],
    thickness: Float[Tensor, "i j k"],
    config: UnseenConfig,
) -> Float[Tensor, "i j k 3"]:
    """Extend the directions of oriented points over the layer's nodes, so that hair lies on the head.

    Args:
        layer: the coarse grid around the head.
        points: where directions are known, metres.
        directions: unit growth directions there.
        thickness: thickness of the hair over the head, metres.
        config: how soon gravity takes over.
    """
    about = (layer.distance > -layer.grid.spacing) & (layer.distance < thickness + 2 * layer.grid.spacing)
    known, weight = average(layer.grid, points, directions, torch.ones_like(points[:, 0]))
    known = functional.normalize(known, dim=-1)
    fixed = weight > 0
    cells = torch.nonzero((about | fixed).reshape(-1)).squeeze(1)
    neighbours = face_neighbours(about | fixed)
    start = pull_push(known, fixed.to(known)).reshape(-1, 3)
    value, rise = start[cells], climbing(thickness, layer.distance, config)
    place = OverHead(layer.outward.reshape(-1, 3), layer.distance.reshape(-1), rise.reshape(-1)).select(cells)
    given, is_fixed = known.reshape(-1, 3)[cells], fixed.reshape(-1)[cells, None]
    is_unseen = layer.unseen.reshape(-1)[cells, None] > 0.5
    down = value.new_tensor(DOWN)
    # A mean of neighbours plus a pull solves a screened Poisson equation, whose solutions decay over `gravity_reach`.
    pull = (layer.grid.spacing / config.gravity_reach) ** 2 / 6
    for _ in range(config.sweeps):
        mean = neighbour_mean(value, neighbours)
        lying = along_head(mean + pull * down, place)
        value = torch.where(is_fixed, given, torch.where(is_unseen, lying, mean))
    return start.index_copy(0, cells, value).reshape(*layer.grid.shape, 3)


def climbing(
    thickness: Float[Tensor, "*place"], distance: Float[Tensor, "*place"], config: UnseenConfig
) -> Float[Tensor, "*place"]:
    """Slope at which hair climbs away from the head: zero at the hair's surface, at most `steepest`."""
    return ((thickness - distance).clamp(min=0) / config.climb).clamp(max=config.steepest)


def along_head(directions: Float[Tensor, "cell 3"], place: OverHead) -> Float[Tensor, "cell 3"]:
    """Constrain directions to lead neither into the head nor away from it more steeply than hair that falls freely.

    Hair rises gently from the skin to the surface of the hair, so that what grows above lies over what grows below. The
    constraint fades beyond `HELD` metres from the head: hair that hangs clear of neck and shoulders falls.
    """
    length = directions.norm(dim=-1, keepdim=True)
    given = (directions * place.outward).sum(dim=-1, keepdim=True)
    falling = (place.outward @ place.outward.new_tensor(DOWN))[:, None].clamp(min=0) * length
    rise = torch.maximum(torch.minimum(given, falling), place.rise[:, None] * length)
    held = (2 - place.distance / HELD).clamp(0, 1)[:, None]
    return directions + held * (rise - given) * place.outward


def harmonic(
    known: Float[Tensor, "x y z channel"],
    fixed: Bool[Tensor, "x y z"],
    domain: Bool[Tensor, "x y z"],
    sweeps: int,
) -> Float[Tensor, "x y z channel"]:
    """Extend known values harmonically: elsewhere in the domain, each value is the mean of its neighbours."""
    domain = domain | fixed
    cells = torch.nonzero(domain.reshape(-1)).squeeze(1)
    neighbours = face_neighbours(domain)
    start = pull_push(known, fixed.to(known)).reshape(-1, known.shape[-1])
    value, is_fixed = start[cells], fixed.reshape(-1)[cells, None]
    given = value
    for _ in range(sweeps):
        value = torch.where(is_fixed, given, neighbour_mean(value, neighbours))
    return start.index_copy(0, cells, value).reshape(known.shape)
