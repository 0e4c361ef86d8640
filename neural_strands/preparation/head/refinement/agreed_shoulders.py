"""Moves neck and shoulders of a fitted head to where the photographs agree about their look.

The template's shoulders differ from the person's in a few numbers only, and clothes stand off the body. A plane sweep
(Collins, A space-sweep approach to true multi-image matching, CVPR 1996) along the normals tells where the surface is:
a small square about each vertex is moved to several heights, and photographs that show it are compared by normalised
cross-correlation. The surface is the smooth one that comes closest to the best heights. From round to round, the
heights are closer together.

The face stays as landmarks and outlines have it: it moves between photographs, and skin has little to correlate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int64
from scipy import sparse
from torch import Tensor
from torch.nn import functional

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.views import View, Views
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.lmvs.orientation import luma
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.laplacian import factorised, laplacian
from neural_strands.preparation.head.shoulders import shoulder_share
from neural_strands.preparation.robust import geman_mcclure
from neural_strands.raster.dilation import widen
from neural_strands.raster.texture import sample_picture

REACHES = (0.016, 0.010, 0.006, 0.004)
"""Largest height of each round, metres, above and below the present surface."""
HEIGHTS = 17
"""Number of heights in each round."""
SIDE, SPACING = 7, 0.0025
"""Points along a side of a square, and the distance between them, metres."""
FACING = 0.45
"""Least cosine between a vertex's normal and the direction to a camera that counts as showing it."""
OCCLUDED = 0.004
"""Distance behind the surface that a camera sees from which a vertex is hidden, metres, beyond the reach."""
PERSON, HAIR = 0.9, 0.05
"""Coverage from which a pixel shows the person, and up to which it shows no hair."""
MARGIN = 3
"""Pixels between a square's middle and the nearest hair or background."""
SURE = 0.99
"""Least share of the pixels from which a point is read that must show the person, or be far from hair."""
FEWEST = 4
"""Fewest photographs that tell a height."""
FAINT = 0.01
"""Contrast (standard deviation of luma) at which a pattern counts half."""
MIXED = 2
"""Times that the correlations of a vertex are averaged with those of its neighbours."""
CLEAR = 0.1
"""How much better than the mean of all heights the best one is if it counts fully."""
EDGE = 0.3
"""Weight of a best height that is the first or the last: the surface may lie farther still."""
ERROR, BEND, MOVE = 0.002, 2.5e-4, 0.03
"""Expected error of a height, Laplacian of the heights (mean of the neighbours less the vertex) and height, metres."""
ROUNDS, STRAY = 5, 3.0
"""Rounds of a robust fit, in which heights this many errors off count a quarter."""
LEAST_SHARE = 0.02
"""Share of the shoulders from which a vertex moves."""


@dataclass(frozen=True)
class _Shot:
    """A photograph.

    Attributes:
        camera: its camera, relative to the torso.
        picture: brightness, whether a pixel shows the person, and whether it is far from hair and background.
    """

    camera: Camera
    picture: Float[Tensor, "height width 3"]


def agreed_shoulders(fitted: FittedHead, views: Views, say: Callable[[str], None]) -> FittedHead:
    """Move neck and shoulders to where photographs agree.

    Args:
        fitted: a head placed on the person; one without a chin stays as it is.
        views: the photographs, with cameras in the head's world; those without a mask of hair or person are not used.
        say: receives messages for the user.

    Returns:
        The head, and `shoulders_moved_mm` among its figures: the median over the vertices that photographs show.
    """
    shots = [shot for shot in map(_shot, views) if shot is not None]
    mesh, chin = fitted.head.mesh, fitted.landmarks[NAMED["chin"]]
    moved, seen = _agreed_surface(mesh, shoulder_share(mesh.vertices, chin).nan_to_num(), shots)
    distance = 1000 * (moved.vertices - mesh.vertices).norm(dim=1)[seen]
    median = float(distance.median()) if len(distance) else 0.0
    if len(distance):
        say(f"Neck and shoulders were moved by {median:.1f} mm in the median, to where photographs agree.")
    figures = {**fitted.figures, "shoulders_moved_mm": round(median, 1)}
    return replace(fitted, head=replace(fitted.head, mesh=moved), figures=figures)


def _shot(view: View) -> _Shot | None:
    if view.hair_mask is None or view.person_mask is None:
        return None
    person = view.person_mask >= PERSON
    near = widen((~person | (view.hair_mask > HAIR)).float(), MARGIN)
    return _Shot(view.camera.on_torso(), torch.stack([luma(view.image), person.float(), 1.0 - near], dim=2))


def _agreed_surface(
    mesh: Mesh, share: Float[Tensor, " vertex"], shots: Sequence[_Shot]
) -> tuple[Mesh, Bool[Tensor, " vertex"]]:
    """Move vertices along their normals to where photographs agree.

    Args:
        mesh: world metres.
        share: how freely each vertex moves, from 0 to 1.
        shots: the photographs.

    Returns:
        The mesh, and which vertices enough photographs show.
    """
    seen = torch.zeros(len(mesh.vertices), dtype=torch.bool)
    free = torch.nonzero(share > LEAST_SHARE).squeeze(1)
    if len(free) == 0 or len(shots) < FEWEST:
        return mesh, seen
    bend = laplacian(mesh)
    neighbours = bend + sparse.diags((bend.diagonal() < 0).astype(float))
    # Vertices that are not free stay, so their equations are left out.
    stiff = sparse.diags((MOVE * share[free].double().numpy()) ** -2)
    smooth = (bend.T @ bend)[free.numpy()][:, free.numpy()] / BEND**2 + stiff
    for reach in REACHES:
        heights, normals = torch.linspace(-reach, reach, HEIGHTS), vertex_normals(mesh)
        alike, count = _correlations(mesh, normals, free, heights, shots)
        shown = count >= FEWEST
        seen = torch.zeros_like(seen).index_fill(0, free[shown], True)
        spread = torch.zeros(len(seen), HEIGHTS + 1, dtype=torch.float64)
        spread[free[shown]] = functional.pad(alike[shown], (0, 1), value=1.0).double()
        mixed = spread.numpy()
        for _ in range(MIXED):
            mixed = 0.5 * (mixed + neighbours @ mixed)
        mixed = mixed[free.numpy()]
        height, weight = _best(torch.from_numpy(mixed[:, :-1] / np.maximum(mixed[:, -1:], 1e-6)), heights)
        moved = _smooth_heights(smooth, height.numpy(), (weight * shown).numpy() / ERROR**2)
        along = torch.zeros(len(seen)).index_copy(0, free, torch.from_numpy(moved).float())
        mesh = replace(mesh, vertices=mesh.vertices + along[:, None] * normals)
    return mesh, seen


def _correlations(
    mesh: Mesh,
    normals: Float[Tensor, "vertex 3"],
    chosen: Int64[Tensor, " chosen"],
    heights: Float[Tensor, " height"],
    shots: Sequence[_Shot],
) -> tuple[Float[Tensor, "chosen height"], Int64[Tensor, " chosen"]]:
    """How alike photographs are around chosen vertices, moved to each height, and how many photographs show them.

    That is the mean correlation of two of them: 1 if all are the same. Squares that reach over the background do not
    count; at heights where fewer than `FEWEST` are left, photographs are not alike at all.
    """
    index, middle, normal = MeshIndex(mesh), mesh.vertices[chosen], normals[chosen]
    squares = _squares(middle, normal)
    total = torch.zeros(len(chosen), len(heights), squares.shape[1])
    alone, counts = total.new_zeros(2, len(chosen), len(heights))
    shown = torch.zeros(len(chosen), dtype=torch.int64)
    for shot in shots:
        used = _shows(shot, HeadView.of(shot.camera, index), middle, normal, float(heights[-1]))
        if len(used) == 0:
            continue
        points = squares[used][:, None] + heights[:, None, None] * normal[used][:, None, None]
        read = _read(shot.picture[..., :2], _places(shot.camera, points.reshape(-1, 3))).view(*points.shape[:3], 2)
        pattern = read[..., 0] - read[..., 0].mean(dim=2, keepdim=True)
        pattern = pattern / (pattern.norm(dim=2, keepdim=True) + FAINT * SIDE)
        whole = (read[..., 1].amin(dim=2) > SURE).float()
        total[used] += whole[..., None] * pattern
        alone[used] += whole * pattern.square().sum(dim=2)
        counts[used] += whole
        shown[used] += 1
    alike = (total.square().sum(dim=2) - alone) / (counts * (counts - 1)).clamp(min=1)
    return torch.where(counts >= FEWEST, alike, 0.0), shown


def _squares(middle: Float[Tensor, "chosen 3"], normal: Float[Tensor, "chosen 3"]) -> Float[Tensor, "chosen point 3"]:
    """Points of a square about each point, in its tangent plane."""
    level = torch.linalg.cross(normal.new_tensor([0.0, 1.0, 0.0]).expand_as(normal), normal)
    across = functional.normalize(level, dim=1)
    along = torch.linalg.cross(normal, across)
    steps = SPACING * (torch.arange(SIDE) - SIDE // 2)
    a, b = (grid.reshape(-1)[None, :, None] for grid in torch.meshgrid(steps, steps, indexing="ij"))
    return middle[:, None] + a * across[:, None] + b * along[:, None]


def _shows(
    shot: _Shot, view: HeadView, middle: Float[Tensor, "chosen 3"], normal: Float[Tensor, "chosen 3"], reach: float
) -> Int64[Tensor, " used"]:
    """Numbers of the points that a photograph shows, facing it."""
    camera, place = shot.camera, _places(shot.camera, middle)
    towards = camera.position - middle
    distance = towards.norm(dim=1)
    inside = ((place > 0) & (place < 1)).all(dim=1) & (camera.project(middle)[1] > 0)
    facing = (towards * normal).sum(dim=1) > FACING * distance
    front = distance < _read(view.head.nan_to_num(posinf=1e3)[..., None], place)[:, 0] + reach + OCCLUDED
    clear = _read(shot.picture, place)[:, 2] > SURE
    return torch.nonzero(inside & facing & front & clear).squeeze(1)


def _places(camera: Camera, points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 2"]:
    """Positions in a picture, from 0 to 1 across and down."""
    pixels, _ = camera.project(points)
    return pixels / pixels.new_tensor([camera.width, camera.height])


def _read(
    picture: Float[Tensor, "height width channel"], place: Float[Tensor, "point 2"]
) -> Float[Tensor, "point channel"]:
    return sample_picture(picture, place.nan_to_num(-1.0).clamp(0, 1))


def _best(
    alike: Float64[Tensor, "vertex height"], heights: Float[Tensor, " height"]
) -> tuple[Float64[Tensor, " vertex"], Float64[Tensor, " vertex"]]:
    """The height at which photographs are most alike, between the given ones, and how much it counts."""
    best = alike.argmax(dim=1)
    middle = best.clamp(1, alike.shape[1] - 2)
    low, most, high = (alike.gather(1, (middle + offset)[:, None])[:, 0] for offset in (-1, 0, 1))
    between = (0.5 * (low - high) / (low - 2 * most + high).clamp(max=-1e-9)).clamp(-0.5, 0.5)
    inner = best == middle
    height = heights.double()[best] + float(heights[1] - heights[0]) * torch.where(inner, between, 0.0)
    clear = ((alike.amax(dim=1) - alike.mean(dim=1)) / CLEAR).clamp(max=1.0)
    return height, torch.where(inner, clear, EDGE * clear)


def _smooth_heights(smooth: sparse.spmatrix, height: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Heights that are smooth and near the given ones, of which strays count little."""
    counts, found = weight, np.zeros_like(height)
    for _ in range(ROUNDS):
        found = factorised(sparse.csc_matrix(smooth + sparse.diags(counts))).solve(counts * height)
        counts = weight * geman_mcclure(((found - height) / (STRAY * ERROR)) ** 2)
    return found
