"""Moves a fitted head to the person's outline where that is bare skin or clothes, and beneath it where it is hair.

Before hair is told from skin, an outline only limits the head, because hair may lie over it (`deform.py`). With masks
of the hair, the rest of the outline tells where the surface is: the smooth displacement is found that brings the
head's own outline there in all photographs. Hair that hangs over the shoulders has a thickness: where the outline is
that of hair, they lie at least so deep beneath it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float64
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, SuperLU, cg
from torch import Tensor

from neural_strands.geometry.mesh import Mesh, interpolate
from neural_strands.geometry.views import View, Views
from neural_strands.preparation.face.topology import INTERIOR, NAMED
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.interpolation import attached
from neural_strands.preparation.head.laplacian import factorised, laplacian
from neural_strands.preparation.head.outline import Contour, Outline
from neural_strands.preparation.head.shoulders import shoulder_share
from neural_strands.preparation.robust import geman_mcclure
from neural_strands.raster.dilation import widen

SIDE = 320
"""Longer side at which outlines are compared, pixels."""
HAIR, MARGIN = 0.05, 3
"""Coverage from which a pixel shows hair, and pixels between it and an outline that counts as bare."""
MOSTLY = 0.5
"""Coverage from which a pixel is mostly hair."""
FARTHEST = 0.03
"""Largest distance of an outline from the person's, metres."""
BOTTOM = 0.04
"""Height above the lower end of the bust from which on its outline counts, metres: there it was only cut off."""
ALONG = 0.5
"""Least cosine between the directions in which the two outlines face."""
BEND, MOVE, SKULL = 3.5e-4, 0.02, 0.004
"""Expected Laplacian of the displacement (mean of the neighbours less the vertex), displacement, and displacement of
the scalp, metres: the hair hides where the skull is."""
LANDMARK = 0.001
"""Expected displacement of a landmark, metres: these have been fitted."""
SHOULDERS, THICK = 0.5, 0.010
"""Share of the shoulders from which hair lies over a face, and its least thickness, metres, where it is the outline."""
ROUNDS, COARSE, FINE = 4, 0.02, 0.004
"""Rounds of the fit, and error of an outline in the first and in the last, metres."""
PRECISION, MOST_ITERATIONS = 1e-5, 2000
"""Relative error of the solution, and iterations after which it has failed."""


@dataclass(frozen=True)
class _Shot:
    """A reduced photograph.

    Attributes:
        outline: the person's outline.
        hair: whether each pixel is near hair.
        strands: whether it is mostly hair, or next to such a pixel.
    """

    outline: Outline
    hair: Bool[Tensor, "height width"]
    strands: Bool[Tensor, "height width"]

    def contours(self, mesh: Mesh, covered: Bool[Tensor, " face"]) -> tuple[Contour, Contour]:
        """The mesh's outline near that of bare skin or clothes, and where it comes too near to that of hair.

        Args:
            mesh: world metres.
            covered: faces of the shoulders, over which hair has a thickness.
        """
        found = self.outline.contour(mesh)
        bare = ~self.hair[found.row, found.column] & ~self.hair[found.nearest[:, 0], found.nearest[:, 1]]
        facing = (found.outward * found.away).sum(dim=1) > ALONG
        height = interpolate(mesh.corners(), found.face, found.barycentric)[:, 1]
        used = facing & (height > mesh.vertices[:, 1].min() + BOTTOM) & (found.gap.abs() < FARTHEST)
        near = replace(found, gap=found.gap + THICK)
        hidden = covered[found.face] & self.strands[found.nearest[:, 0], found.nearest[:, 1]] & (near.gap > 0)
        return found.chosen(bare & used), near.chosen(hidden & used)


def to_bare_outline(fitted: FittedHead, views: Views, say: Callable[[str], None]) -> FittedHead:
    """Move a head to the person's outline where it is not hair.

    Args:
        fitted: a head placed on the person.
        views: the photographs, with cameras in the head's world; those without a mask of hair or person are not used.
        say: receives messages for the user.

    Returns:
        The head, with its landmarks where they were, and `outline_gap_mm` among its figures: the median distance of
        its bare outline from the person's.
    """
    shots = [shot for shot in map(_shot, views.reduced(SIDE)) if shot is not None]
    mesh = fitted.head.mesh
    covered = shoulder_share(mesh.corners().mean(dim=1), fitted.landmarks[NAMED["chin"]]) > SHOULDERS
    contours = [shot.contours(mesh, covered) for shot in shots]
    before = _median_gap(contours)
    if before is None:
        return fitted
    stiffness = _stiffness(fitted)
    factors = factorised(stiffness)
    for error in np.geomspace(COARSE, FINE, ROUNDS).tolist():
        system, right = _outline_equations(fitted.head.mesh, mesh, shots, contours, error)
        moved = _solve(stiffness, factors, system, right)
        mesh = replace(mesh, vertices=fitted.head.mesh.vertices + torch.from_numpy(moved).to(mesh.vertices))
        contours = [shot.contours(mesh, covered) for shot in shots]
    after = _median_gap(contours)
    figures = dict(fitted.figures)
    if after is not None:
        say(f"Ears, jaw and neck: {after:.1f} mm from the outlines in the median, {before:.1f} mm before.")
        figures["outline_gap_mm"] = round(after, 2)
    return replace(fitted, head=replace(fitted.head, mesh=mesh), figures=figures)


def _shot(view: View) -> _Shot | None:
    if view.hair_mask is None or view.person_mask is None:
        return None
    outline = Outline.of(view.camera, view.person_mask.numpy(), SIDE)
    near, strands = widen((view.hair_mask > HAIR).float(), MARGIN), widen((view.hair_mask > MOSTLY).float(), 1)
    return _Shot(outline, near > 0, strands > 0)


def _median_gap(contours: Sequence[tuple[Contour, Contour]]) -> float | None:
    """Median distance of the bare outlines, mm; None if there are none."""
    gaps = [bare.gap.abs() for bare, _ in contours]
    together = torch.cat(gaps) if gaps else torch.zeros(0)
    return 1000 * float(together.median()) if len(together) else None


def _outline_equations(
    rest: Mesh, current: Mesh, shots: Sequence[_Shot], contours: Sequence[tuple[Contour, Contour]], error: float
) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Normal equations for the displacement of x, then y, then z of all vertices that brings the outlines together."""
    count = len(rest.vertices)
    now = (current.vertices - rest.vertices).double().numpy().T.ravel()
    system, right = sparse.csr_matrix((3 * count, 3 * count)), np.zeros(3 * count)
    pairs = zip(shots, contours, strict=True)
    for shot, contour in ((shot, contour) for shot, pair in pairs for contour in pair):
        rotation = shot.outline.camera.rotation
        corners, points = rest.faces[contour.face].numpy(), len(contour.face)
        number = np.repeat(np.arange(points), 3)
        at = sparse.csr_matrix(
            (contour.barycentric.double().numpy().ravel(), (number, corners.ravel())), (points, count)
        )
        across = (contour.away @ rotation[:2]).double().numpy()
        slope = sparse.csr_matrix(sparse.hstack([sparse.diags(across[:, axis]) @ at for axis in range(3)]))
        gap = contour.gap.double().numpy()
        weight = geman_mcclure((gap / error) ** 2) / error**2
        system = system + slope.T @ sparse.diags(weight) @ slope
        right = right + slope.T @ (weight * (slope @ now - gap))
    return system.tocsr(), right


def _solve(
    stiffness: sparse.csc_matrix, factors: SuperLU, system: sparse.csr_matrix, right: np.ndarray
) -> Float64[np.ndarray, "vertex 3"]:
    """The displacement, by conjugate gradients.

    Only the outlines couple the axes, and they concern few vertices: the factors of the stiffness, which is the same
    for each axis, are a good preconditioner, and a tenth of the work of factors of everything together.
    """
    count = len(right)
    together = sparse.csr_matrix(sparse.block_diag([stiffness] * 3) + system)
    easier = LinearOperator((count, count), lambda values: factors.solve(values.reshape(3, -1).T).T.ravel())
    found, failed = cg(together, right, rtol=PRECISION, maxiter=MOST_ITERATIONS, M=easier)
    if failed:
        raise RuntimeError(f"the displacement was not found in {MOST_ITERATIONS} iterations")
    return found.reshape(3, -1).T


def _stiffness(fitted: FittedHead) -> sparse.csc_matrix:
    """Equations of each axis for a displacement that is smooth and small, and smaller at landmarks and scalp."""
    mesh = fitted.head.mesh
    expected = np.full(len(mesh.vertices), MOVE)
    expected[mesh.faces[fitted.head.scalp_faces].unique().numpy()] = SKULL
    bend, inside = laplacian(mesh), fitted.landmarks[list(INTERIOR)]
    landmarks = attached(mesh, inside[torch.isfinite(inside).all(dim=1)])
    small = sparse.diags(expected**-2) + (landmarks.T @ landmarks) / LANDMARK**2
    return sparse.csc_matrix((bend.T @ bend) / BEND**2 + small)
