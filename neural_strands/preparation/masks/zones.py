"""Prior probability of hair at each pixel of the person, from the placed head alone."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import vertex_normals
from neural_strands.preparation.face.topology import INTERIOR, NAMED
from neural_strands.preparation.head.template import near_landmarks
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.head import Head

FACE, CHEEK, SCALP, SIDE, NECK = 0.02, 0.10, 0.93, 0.40, 0.20
"""Probability of hair in front of the face below the brows, its border, the scalp, ears and nape, and everything below
the chin."""
FOREHEAD = ((0.0, 0.03, 0.06, 0.09), (0.10, 0.20, 0.50, 0.93))
"""Heights above the brows, metres, and the probability of hair there: hairlines differ, and fringes hang down."""
FRONTAL = 0.3
"""Least z of the normals of the head's front."""
BESIDE, BELOW = 0.93, 0.30
"""Probability of hair beside the head's silhouette: above the chin, and a hand's breadth below it."""
FEWEST_VOTES = 2
HAND = 0.10
"""Length over which the one changes into the other, metres."""


@dataclass(frozen=True)
class Shown:
    """The head's vertices that one view shows.

    Attributes:
        vertex: (shown,) numbers of the visible vertices.
        pixel: (shown, 2) column and row of each, integers.
    """

    vertex: np.ndarray
    pixel: np.ndarray


@dataclass(frozen=True)
class Zones:
    """The zones of the placed head in one view.

    Attributes:
        prior: (height, width) probability that a pixel of the person is hair.
        face: (height, width) the face below the brows: skin, except for eyes, mouth and beard.
        scalp: (height, width) the scalp.
        head: (height, width) the head above the chin.
        below_chin: (height, width) pixels that show something lower than the chin, if it is as far away as the scalp.
        shown: the template's vertices that are visible in the view.
    """

    prior: np.ndarray
    face: np.ndarray
    scalp: np.ndarray
    head: np.ndarray
    below_chin: np.ndarray
    shown: Shown


@dataclass(frozen=True)
class ZonedHead:
    """A head in world metres, with the zone of each vertex.

    Attributes:
        head: the placed template.
        prior: (vertex,) probability of hair in front of each vertex.
        on_face: (vertex,) whether the vertex belongs to the face below the brows.
        chin: height of the chin, metres.
    """

    head: Head
    prior: Float[Tensor, " vertex"]
    on_face: Tensor
    chin: float

    @classmethod
    def of(cls, head: Head, landmarks: Float[Tensor, "landmark 3"]) -> "ZonedHead":
        """Determine the zones from the template's landmarks, in world metres."""
        vertices = head.mesh.vertices
        brow_height = landmarks[[NAMED["right_brow_inner"], NAMED["left_brow_inner"]], 1].nanmean()
        chin = landmarks[NAMED["chin"], 1]
        marks = landmarks[list(INTERIOR)]
        marks = marks[torch.isfinite(marks).all(dim=1)]
        height = vertices[:, 1]
        on_face = near_landmarks(vertices, landmarks) & (height < brow_height - 0.005)
        prior = torch.full_like(height, SIDE)
        prior[height < chin - 0.01] = NECK
        prior[head.mesh.faces[head.scalp_faces].unique()] = SCALP
        front = (vertices[:, 2] > marks[:, 2].quantile(0.2)) & (vertex_normals(head.mesh)[:, 2] > FRONTAL)
        above = (height - brow_height).numpy()
        forehead = torch.from_numpy(np.interp(above, *FOREHEAD)).to(prior)
        prior = torch.where(front & (height > brow_height), forehead, prior)
        prior[front & (height <= brow_height) & (height >= chin - 0.01)] = CHEEK
        prior[on_face] = FACE
        return cls(head, prior, on_face, float(chin))

    def seen_by(self, camera: Camera, prior: Float[Tensor, " vertex"] | None = None) -> Zones:
        """Project the zones into a view; `prior`, if given, replaces the vertices' own."""
        mesh = self.head.mesh
        values = self.prior if prior is None else prior
        buffer = rasterise_triangles(camera.posed(mesh.vertices), mesh.faces, camera)
        face = buffer.face.clamp(min=0)
        covered = buffer.face >= 0
        inside = (values[mesh.faces[face]] * buffer.barycentric).sum(dim=-1)
        on_face = (self.on_face.float()[mesh.faces[face]] * buffer.barycentric).sum(dim=-1) > 0.99
        depth = (self.head.scalp_mesh.corners().mean(dim=(0, 1)) - camera.position) @ camera.rotation[2]
        height = camera.unproject(camera.pixel_centres(), depth.expand(camera.height, camera.width))[..., 1]
        below = ((self.chin - height) / HAND).clamp(0.0, 1.0)
        whole = torch.where(covered, inside, BESIDE + (BELOW - BESIDE) * below)
        pixel, distance = camera.project(mesh.vertices)
        column, row = pixel.nan_to_num(-1.0).floor().long().unbind(dim=1)
        within = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height) & (distance > 0)
        column, row = column.clamp(0, camera.width - 1), row.clamp(0, camera.height - 1)
        shown = within & (distance < buffer.depth[row, column] + 0.004)
        return Zones(
            whole.numpy(),
            (covered & on_face).numpy(),
            (covered & torch.isin(buffer.face, self.head.scalp_faces)).numpy(),
            (covered & (height > self.chin)).numpy(),
            (height < self.chin).numpy(),
            Shown(shown.nonzero()[:, 0].numpy(), torch.stack([column, row], dim=1)[shown].numpy()),
        )


class Ballot:
    """Votes of views on whether hair lies in front of each vertex of the head; views are added one at a time."""

    def __init__(self, vertices: int) -> None:
        self._total = np.zeros(vertices)
        self._count = np.zeros(vertices)

    def add(self, shown: Shown, coverage: np.ndarray) -> None:
        """Count a view's hair (height, width), in [0, 1], at the vertices that it shows."""
        column, row = shown.pixel.T
        self._total[shown.vertex] += coverage[row, column]
        self._count[shown.vertex] += 1

    def shares(self) -> np.ndarray:
        """Share of views (vertex,) in which each vertex is behind hair; NaN where fewer than two views show it."""
        return np.where(self._count >= FEWEST_VOTES, self._total / np.maximum(self._count, 1), np.nan)
