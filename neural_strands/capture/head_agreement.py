"""Agreement of a head with the masks of the photographs: does it lie where the hair and the person are?

In every view, hair covers the visible scalp of a correctly placed head. A head that is shifted, turned or of the wrong
size shows scalp where the masks have no hair, or has hair all over its face.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import Views
from neural_strands.raster.dilation import widen
from neural_strands.raster.triangles import rasterise_triangles

LONGEST_SIDE = 192
"""Longer side of views as compared, pixels; one pixel is then about 3 mm on a head that fills the image."""
SOME = 0.25
"""Coverage above which a pixel contains some hair (or person); low, because masks of thin hair have holes."""
MOST = 0.5
"""Coverage above which a pixel shows hair rather than skin."""


@dataclass(frozen=True)
class HeadAgreement:
    """Shares of the visible head, in [0, 1]; None if no view shows that part.

    Attributes:
        scalp_in_hair: share of the visible scalp inside hair masks, or within a pixel of them; near 1 for a correct
            head.
        skin_in_hair: share of the other visible skin above the scalp's lowest point that is inside hair masks; small,
            unless hair falls over the face.
        head_in_person: share of the visible head inside person masks, or within a pixel of them; near 1 for a correct
            head.
    """

    scalp_in_hair: float | None
    skin_in_hair: float | None
    head_in_person: float | None


def head_agreement(head: Mesh, scalp_faces: Int64[Tensor, " scalp"], views: Views) -> HeadAgreement:
    """Compare the visible parts of a head with the masks, over the pixels of all views together.

    Args:
        head: the whole head, in the cameras' frame.
        scalp_faces: the faces that hair grows from.
        views: cameras with their masks; no photograph is read.
    """
    is_scalp = torch.zeros(len(head.faces), dtype=torch.bool)
    is_scalp[scalp_faces] = True
    heights = head.corners()[..., 1]
    # Below the lowest scalp, hair hangs over neck and shoulders; above it, skin is bare except for hair over the face.
    is_skin = ~is_scalp & (heights.amin(dim=1) >= heights[is_scalp].min())
    views = views.reduced(LONGEST_SIDE)
    scalp, skin, whole = _Share(), _Share(), _Share()
    for index, camera in enumerate(views.cameras):
        hair, person = views.hair_mask(index), views.person_mask(index)
        if hair is None and person is None:
            continue
        face = rasterise_triangles(camera.posed(head.vertices), head.faces, camera).face
        drawn, face = face >= 0, face.clamp(min=0)
        if hair is not None:
            scalp.add(drawn & is_scalp[face], _near(hair))
            skin.add(drawn & is_skin[face], hair >= MOST)
        if person is not None:
            whole.add(drawn, _near(person))
    return HeadAgreement(scalp.value, skin.value, whole.value)


class _Share:
    """Counts the share of visible pixels that lie inside masks."""

    def __init__(self) -> None:
        self._seen = self._inside = 0

    def add(self, seen: Bool[Tensor, "height width"], inside: Bool[Tensor, "height width"]) -> None:
        """Count the pixels of one view."""
        self._seen += int(seen.sum())
        self._inside += int((seen & inside).sum())

    @property
    def value(self) -> float | None:
        """The share so far; None if nothing was counted."""
        return self._inside / self._seen if self._seen else None


def _near(mask: Float[Tensor, "height width"]) -> Bool[Tensor, "height width"]:
    """Pixels with some coverage in them or in a neighbour."""
    return widen(mask, 1) >= SOME
