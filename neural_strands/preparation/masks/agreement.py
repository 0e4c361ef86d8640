"""Judges parts of a hair mask that are apart from the rest by what the other views show at the same place.

The hair beside the far cheek, or a lock on the far shoulder, is apart from the other hair. So are a beard, a shadow on
the neck and a strip of background, whose colours may be the same. The other views tell them apart: where there is hair,
several of them show it, and hardly any sees through.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int, Shaped
from torch import Tensor

from neural_strands.capture.images import reduced
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.visual_hull import HeadView, Silhouette, points_before_head, possible_points
from neural_strands.raster.dilation import widen

LONGEST_SIDE = 512
"""Longer side of the masks as compared, pixels."""
SOME, CERTAIN = 0.2, 0.5
"""Coverage up to which a pixel is empty, and above which it certainly shows hair."""
WITNESSES = 2
"""Number of other views that must show hair at a place, and that must not see through it."""
PIXELS = 60
"""Largest number of pixels of a part that are examined."""
STEP, REACH = 0.006, 0.5
"""Distance between the points of a ray, and from the middle of the head to the farthest of them, metres."""


@dataclass(frozen=True)
class Agreement:
    """The masks of all views.

    Attributes:
        cameras: of the masks to judge.
        possible: where each view does not see through.
        doubtful: where each view does not surely show hair.
        head: stops rays, and hides what is behind it.
        middle: of the head.
    """

    cameras: Sequence[Camera]
    possible: Sequence[Silhouette]
    doubtful: Sequence[Silhouette]
    head: MeshIndex
    middle: Tensor

    @classmethod
    def of(
        cls, cameras: Sequence[Camera], masks: Iterable[Bool[np.ndarray, "height width"]], head: Mesh
    ) -> "Agreement":
        """Collect the views.

        Args:
            cameras: of the masks.
            masks: where each view shows hair, as far as is known.
            head: in the cameras' frame.
        """
        index = MeshIndex(head)
        possible, doubtful = [], []
        for camera, mask in zip(cameras, masks, strict=True):
            view = HeadView.of(camera.reduced(LONGEST_SIDE), index)
            covered = torch.from_numpy(reduced(mask.astype(np.uint8) * np.uint8(255), LONGEST_SIDE)).float() / 255
            # Widened by a pixel, because cameras are a little off.
            possible.append(Silhouette(view, widen(covered, 1) >= SOME))
            doubtful.append(Silhouette(view, covered <= CERTAIN))
        return cls(tuple(cameras), possible, doubtful, index, head.vertices.mean(dim=0))

    def shares(
        self, number: int, parts: Shaped[np.ndarray, "height width"], names: Int[np.ndarray, " part"]
    ) -> Float64[np.ndarray, " part"]:
        """Share of the pixels of parts of a view's mask along whose rays the other views agree on hair.

        Args:
            number: of the view.
            parts: number of the part at each pixel.
            names: numbers of the parts to judge.
        """
        pixels = [np.argwhere(parts == name)[:, ::-1] for name in names.tolist()]
        chosen = [each[:: max(1, -(-len(each) // PIXELS))] for each in pixels]
        if not chosen:
            return np.zeros(0)
        camera, joined = self.cameras[number], torch.from_numpy(np.concatenate(chosen))
        rays = camera.rays(joined.float() + 0.5)
        points, counted = points_before_head(camera, rays, self.middle, self.head, STEP, REACH)
        flat = points[counted]
        here = possible_points(flat, _others(self.possible, number), WITNESSES)
        here &= ~possible_points(flat, _others(self.doubtful, number), WITNESSES)
        agreed = torch.zeros_like(counted)
        agreed[counted] = here
        hits = np.split(agreed.any(dim=1).numpy(), np.cumsum([len(each) for each in chosen])[:-1])
        return np.array([hit.mean() for hit in hits])


def _others(silhouettes: Sequence[Silhouette], number: int) -> list[Silhouette]:
    return [each for index, each in enumerate(silhouettes) if index != number]
