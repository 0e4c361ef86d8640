"""Growth direction: a sign for every segment so that it runs from root to tip (paper, after Chai 2013).

Each segment carries one unknown in [-1, 1]. Neighbouring segments on about the same line should have the same sign,
segments that leave the scalp should point away from it, and otherwise hair should point downwards. Minimising the sum
of squares is a sparse linear system: diffusion with soft anchors. Strokes are anchors that outweigh all others.

Where stereo finds little, segments form many patches with gaps between them. A patch that lies level on the head says
nothing about its own sign, so weaker ties reach to patches beside it, and those that hang decide for those that do not.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import cg
from scipy.spatial import KDTree
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import signed_distance


@dataclass(frozen=True)
class GrowthConfig:
    """Weights of the diffusion.

    Lengths are multiples of the spacing of the segments' points unless stated otherwise.
    """

    reach: Annotated[float, Between(0.1, 1000)] = 12.0
    """Distance within which neighbours are searched."""
    neighbours: Annotated[int, Between(1, 1000)] = 12
    """Largest number of neighbours of a point."""
    angle: Annotated[float, Between(0, 90)] = 35.0
    """Neighbours with a larger angle are ignored, degrees."""
    far: Annotated[float, Between(0, 1000)] = 0.1
    """Weight of far ties, which bridge gaps between patches of segments; the nearest neighbours have a weight of 1."""
    far_reach: Annotated[float, Between(0.1, 10_000)] = 50.0
    """Distance within which far ties are searched."""
    far_neighbours: Annotated[int, Between(1, 1000)] = 24
    """Largest number of far ties of a point."""
    far_cell: Annotated[float, Between(0.1, 1000)] = 8.0
    """Edge of the cubes of which only the most confident point has far ties, so that they lead out of a dense patch."""
    scalp_reach: Annotated[float, Between(1e-6, 10)] = 0.03
    """Distance from the head at which its pull falls to 1/e, as a share of the head's size."""
    scalp: Annotated[float, Between(0, 1e6)] = 1e-4
    """Weight of pointing away from the head; the tie between two segments has weight up to 1.

    This and `gravity` are so small that neighbours alone determine which segments point the same way; the two only
    choose between the two signs of a mass of hair. If stronger, they would reverse parts of it, such as hair that rises
    at the root before it falls."""
    gravity: Annotated[float, Between(0, 1e6)] = 1.5e-5
    """Weight of pointing downwards."""
    stroke: Annotated[float, Between(0, 1e6)] = 100.0
    """Weight of following a stroke."""
    stroke_reach: Annotated[float, Between(0.01, 1000)] = 10.0
    """Distance up to which a stroke pulls."""


def orient_segments(
    segments: LineSegments,
    head: Mesh | None,
    scalp_faces: Int64[Tensor, " scalp"] | None,
    strokes: list[Float[Tensor, "point 3"]],
    config: GrowthConfig,
    up: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> LineSegments:
    """Sign every segment so that it runs from root to tip; the points of reversed segments are reversed too.

    Args:
        segments: chains whose directions follow their points.
        head: the head, if it is known; without one only gravity and strokes determine the direction.
        scalp_faces: the faces of the head that hair grows from, if known: hair points away from these alone, because
            away from the shoulders would be upwards.
        strokes: polylines drawn from root to tip, metres.
        config: weights.
        up: direction opposite to gravity, in world axes.
    """
    if len(segments) == 0:
        return segments
    points = segments.points.cpu().double().numpy()
    lines = segments.directions.cpu().double().numpy()
    owner = segments.segment_id.cpu().numpy()
    count = segments.segment_count
    spacing = _spacing(points, owner)
    pull = -config.gravity * (lines @ np.asarray(up))
    weight = np.full(len(points), float(config.gravity))
    if head is not None:
        skin = head if scalp_faces is None else Mesh(head.vertices, head.faces[scalp_faces])
        away, strength = _away_from_head(segments, skin, config)
        pull += strength * (lines * away).sum(-1)
        weight += strength
    for stroke in strokes:
        along, strength = _near_stroke(points, stroke.cpu().double().numpy(), config, spacing)
        pull += strength * (lines * along).sum(-1)
        weight += strength
    anchor = np.bincount(owner, weights=pull, minlength=count)
    anchored = np.bincount(owner, weights=weight, minlength=count)
    ties = _near_ties(points, lines, owner, spacing, config)
    if config.far > 0:
        confidence = segments.confidence.cpu().double().numpy()
        ties = ties + _far_ties(points, lines, owner, confidence, spacing, config)
    ties = ties + ties.T
    diagonal = np.asarray(abs(ties).sum(axis=1)).ravel() + anchored + 1e-9
    # With such weak anchors the solver reaches its last iteration on large captures, but signs settle long before
    # values.
    sign, _ = cg(diags(diagonal) - ties, anchor, rtol=1e-10, maxiter=1000, M=diags(1 / diagonal))
    return flip_segments(segments, torch.from_numpy(sign < 0).to(segments.points.device))


def flip_segments(segments: LineSegments, flip: Tensor) -> LineSegments:
    """Reverse the segments selected by `flip`: the order of their points and their directions."""
    owner = segments.segment_id
    sizes = torch.bincount(owner, minlength=len(flip))
    start = sizes.cumsum(0) - sizes
    index = torch.arange(len(owner), device=owner.device)
    mirrored = 2 * start[owner] + sizes[owner] - 1 - index
    order = torch.where(flip[owner], mirrored, index)
    sign = torch.where(flip[owner], -1.0, 1.0)[:, None].to(segments.directions)
    return LineSegments(
        segments.points[order], segments.directions[order] * sign, segments.confidence[order], segments.segment_id
    )


def _spacing(points: np.ndarray, owner: np.ndarray) -> float:
    """Median distance between neighbouring points of the same segment."""
    same = owner[1:] == owner[:-1]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1)[same]
    return float(np.median(steps)) if len(steps) else 1.0


def _away_from_head(segments: LineSegments, head: Mesh, config: GrowthConfig) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors away from the head, and the weights of their anchors."""
    size = float((head.vertices.amax(0) - head.vertices.amin(0)).norm())
    found = signed_distance(segments.points.float(), head)
    strength = config.scalp * torch.exp(-found.distance.abs() / (config.scalp_reach * size))
    return found.normal.cpu().double().numpy(), strength.cpu().double().numpy()


def _near_stroke(
    points: np.ndarray, stroke: np.ndarray, config: GrowthConfig, spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Direction of the nearest piece of a stroke, and the weights of its anchors."""
    steps = np.linalg.norm(np.diff(stroke, axis=0), axis=-1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    fine = np.linspace(0.0, arc[-1], max(2, math.ceil(arc[-1] / spacing) + 1))
    dense = np.stack([np.interp(fine, arc, stroke[:, axis]) for axis in range(3)], axis=1)
    along = np.gradient(dense, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-12)
    distance, nearest = KDTree(dense).query(points)
    strength = config.stroke * np.exp(-((distance / (config.stroke_reach * spacing)) ** 2))
    return along[nearest], strength


def _near_ties(
    points: np.ndarray, lines: np.ndarray, owner: np.ndarray, spacing: float, config: GrowthConfig
) -> csr_matrix:
    """Ties of every second point to its nearest neighbours (see `_ties`)."""
    chosen, every = np.arange(0, len(points), 2), np.arange(len(points))
    reach = config.reach * spacing
    return _ties(owner, *_pairs(points, lines, owner, (chosen, every), reach, config.neighbours, config.angle))


def _far_ties(
    points: np.ndarray,
    lines: np.ndarray,
    owner: np.ndarray,
    confidence: np.ndarray,
    spacing: float,
    config: GrowthConfig,
) -> csr_matrix:
    """Ties between the most confident points of cubes, for hair side by side (see `_ties`).

    Hair farther along a line may come from the other side of a parting, where it grows the opposite way.
    """
    cubes = np.floor(points / (config.far_cell * spacing)).astype(np.int64)
    order = np.argsort(-confidence, kind="stable")
    _, most = np.unique(cubes[order], axis=0, return_index=True)
    some, reach = order[most], config.far_reach * spacing
    first, second, weight = _pairs(points, lines, owner, (some, some), reach, config.far_neighbours, config.angle)
    towards = points[second] - points[first]
    towards /= np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-12)
    along = np.maximum((towards * lines[first]).sum(-1) ** 2, (towards * lines[second]).sum(-1) ** 2)
    return _ties(owner, first, second, config.far * (1 - along) * weight)


def _pairs(
    points: np.ndarray,
    lines: np.ndarray,
    owner: np.ndarray,
    between: tuple[np.ndarray, np.ndarray],
    reach: float,
    neighbours: int,
    angle: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbouring points of different segments on about the same line, and the weights of their ties.

    Args:
        points: of all segments.
        lines: unit directions there.
        owner: segment of each point.
        between: indices of points, and of those among which their neighbours are searched.
        reach: distance up to which they are searched.
        neighbours: largest number of neighbours of a point.
        angle: neighbours with a larger angle are ignored, degrees.
    """
    chosen, others = between
    distance, index = KDTree(points[others]).query(
        points[chosen], k=neighbours + 1, distance_upper_bound=reach, workers=-1
    )
    first, distance, index = np.repeat(chosen, neighbours + 1), distance.ravel(), index.ravel()
    found = np.isfinite(distance)
    first, second, distance = first[found], others[index[found]], distance[found]
    cosine = (lines[first] * lines[second]).sum(-1)
    kept = (np.abs(cosine) > math.cos(math.radians(angle))) & (owner[first] != owner[second])
    weight = np.exp(-((distance[kept] / (0.5 * reach)) ** 2)) * cosine[kept]
    return first[kept], second[kept], weight


def _ties(owner: np.ndarray, first: np.ndarray, second: np.ndarray, weight: np.ndarray) -> csr_matrix:
    """Sums over pairs of points of the weight of their segments having equal (positive) or opposite signs."""
    count = int(owner[-1]) + 1
    return csr_matrix((weight, (owner[first], owner[second])), shape=(count, count))
