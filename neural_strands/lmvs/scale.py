"""Checks that head and cameras are plausibly in metres and of the same scale."""

import logging
from collections.abc import Sequence

from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.lmvs.region import Region, seen_radii

log = logging.getLogger(__name__)

SMALLEST, LARGEST = 0.05, 3.0
"""Smallest and largest extent of a head or hair, metres: from a doll's head to a body with hair to the ground."""
RATIO = 5.0
"""A camera whose scale differs from the others' by this factor has another unit."""


def check_head_size(head: Mesh | None) -> None:
    """Reject a head whose size in metres is implausible.

    Raises:
        InputError: its longest side is not plausible for a head or a body.
    """
    if head is None:
        return
    extent = float((head.vertices.amax(dim=0) - head.vertices.amin(dim=0)).max())
    if not SMALLEST <= extent <= LARGEST:
        raise InputError(
            f"wrong scale: expected a head in metres, {SMALLEST:g} to {LARGEST:g} m along its longest side, found "
            f"{extent:.3g} m; bring the capture to metres."
        )


def in_metres(region: Region) -> bool:
    """Whether the region that the cameras see has the size of hair in metres."""
    return SMALLEST <= 2 * region.radius <= LARGEST


def of_one_scale(cameras: Sequence[Camera], hairs: Sequence[Tensor]) -> list[bool]:
    """Whether each camera is about as far from the hair as the others; much farther ones are named in a warning.

    A camera that is much too near lies inside the head, or is a close-up of part of the hair.

    Args:
        cameras: at least two.
        hairs: bounding box of the hair in each camera, pixels: left, top, right, bottom.
    """
    _, radii = seen_radii(cameras, hairs)
    common = sorted(radii)[(len(radii) - 1) // 2]
    kept = [radius <= RATIO * common for radius in radii]
    for camera, radius, fine in zip(cameras, radii, kept, strict=True):
        if not fine:
            log.warning(
                "%s: wrong scale: seen from its camera the hair is %.3g m in radius, from the others %.3g m; the view "
                "is left out.",
                camera.name or "a view without a name",
                radius,
                common,
            )
    return kept


def check_scene(region: Region, head: Mesh | None) -> None:
    """Compare the region of hair with the head or, without one, with the usual size of hair.

    Without a head, an implausible size is only a warning: a calibration from photographs alone has no unit, and all
    lengths here follow the pixel footprint.

    Raises:
        InputError: the head is not where the cameras see hair, or has another scale.
    """
    if head is None:
        if not in_metres(region):
            log.warning(
                "The capture is not in metres: what the cameras look at is %.3g across; the segments keep its unit.",
                2 * region.radius,
            )
        return
    low, high = head.vertices.amin(dim=0), head.vertices.amax(dim=0)
    size, away = 0.5 * float((high - low).norm()), float((0.5 * (low + high) - region.centre).norm())
    if not 1 / RATIO < region.radius / size < RATIO:
        raise InputError(
            f"wrong scale: expected cameras in the head's unit, whose hair spans about {2 * size:.2g} m, found cameras "
            f"that see hair {2 * region.radius:.3g} m across; bring head and cameras to one scale."
        )
    if away > size + region.radius:
        raise InputError(
            f"expected the head where the cameras see the hair (radius {region.radius:.3g} m), found a head of radius "
            f"{size:.3g} m, {away:.3g} m away; bring head and cameras to one scale and frame."
        )
