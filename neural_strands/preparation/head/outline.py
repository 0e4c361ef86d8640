"""The outline of a person in a picture, and how far the outline of a mesh is from it."""

from dataclasses import dataclass, fields

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int64
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.raster.triangles import rasterise_triangles

SMOOTHED = 1.5
"""Blur of a distance before its direction of growth is computed, pixels (standard deviation)."""


@dataclass(frozen=True)
class Contour:
    """Pixels on the outline of a mesh in a picture, just within it.

    Attributes:
        row, column: their pixels.
        face, barycentric: where they lie on the mesh.
        gap: signed distance of the mesh's outline from the person's there, positive outside, metres.
        away: unit direction in the picture in which this distance grows.
        outward: unit direction in the picture away from the mesh.
        nearest: row and column of the person's outline there.
    """

    row: Int64[Tensor, " point"]
    column: Int64[Tensor, " point"]
    face: Int64[Tensor, " point"]
    barycentric: Float[Tensor, "point 3"]
    gap: Float[Tensor, " point"]
    away: Float[Tensor, "point 2"]
    outward: Float[Tensor, "point 2"]
    nearest: Int64[Tensor, "point 2"]

    def chosen(self, which: Bool[Tensor, " point"]) -> "Contour":
        """Some of the points."""
        return Contour(*(getattr(self, field.name)[which] for field in fields(self)))


@dataclass(frozen=True)
class Outline:
    """The outline of a person in a small picture.

    Attributes:
        camera: camera of the small picture.
        distance: signed distance of pixels from the outline, positive outside, pixels.
        away: unit direction in which it grows.
    """

    camera: Camera
    distance: Float32[Tensor, "height width"]
    away: Float32[Tensor, "height width 2"]

    @classmethod
    def of(cls, camera: Camera, person: Float32[np.ndarray, "height width"], side: int) -> "Outline":
        """Reduce a picture.

        Args:
            camera: camera of the picture.
            person: share of each of its pixels that shows the person.
            side: longer side of the small picture, pixels.
        """
        small = camera.reduced(side)
        shrunk = cv2.resize(person, (small.width, small.height), interpolation=cv2.INTER_AREA)
        distance = _signed_distance(shrunk > 0.5)
        return cls(small, distance, _growth(distance))

    def contour(self, mesh: Mesh) -> Contour:
        """The outline of a mesh, where it is nearer to the person's outline than to the border of the picture."""
        camera = self.camera
        buffer = rasterise_triangles(camera.posed(mesh.vertices), mesh.faces, camera)
        own = _signed_distance((buffer.face >= 0).numpy())
        row, column = torch.nonzero((own < 0) & (own > -1)).unbind(dim=1)
        distance, away = self.distance[row, column], self.away[row, column]
        metres = buffer.depth[row, column] / camera.intrinsics[0, 0]
        places = torch.stack([row, column], dim=1)
        nearest = (places - distance[:, None] * away.flip(1)).round().long()
        size = torch.tensor([camera.height, camera.width])
        contour = Contour(
            row,
            column,
            buffer.face[row, column],
            buffer.barycentric[row, column],
            (distance - own[row, column]) * metres,
            away,
            _growth(own)[row, column],
            nearest.clamp(min=0).minimum(size - 1),
        )
        # Beyond the border of the picture nothing is known.
        border = torch.cat([places, size - 1 - places], dim=1).amin(dim=1)
        return contour.chosen((border > 0) & (distance.abs() < border))


def _signed_distance(inside: Bool[np.ndarray, "height width"]) -> Float32[Tensor, "height width"]:
    """Distance of pixels from the border of a region, negative inside, pixels; the picture's border is none."""
    # Without a border, OpenCV's distances are huge.
    within, beyond = (
        cv2.distanceTransform(each.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE).clip(max=sum(inside.shape))
        for each in (inside, ~inside)
    )
    return torch.from_numpy(np.where(inside, 0.5 - within, beyond - 0.5).astype(np.float32))


def _growth(distance: Float32[Tensor, "height width"]) -> Float32[Tensor, "height width 2"]:
    """Unit direction (across, down) in the picture in which a distance grows."""
    rows, columns = np.gradient(cv2.GaussianBlur(distance.numpy(), (0, 0), SMOOTHED))
    return torch.nn.functional.normalize(torch.from_numpy(np.stack([columns, rows], axis=-1)), dim=-1)
