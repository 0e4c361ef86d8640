"""The matcher's input from a view: orientation, its confidence and brightness per pixel, and the pixels of hair."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.lmvs.orientation import OrientationConfig, OrientationMap, luma, orientation_map
from neural_strands.raster.dilation import widen
from neural_strands.raster.gaussian_blur import gaussian_blur

LEAST_COHERENCE = 0.12
"""A neighbourhood whose mean confidence of orientation is lower is not hair."""
LEAST_SHARE = 0.15
"""Connected patches of texture smaller than this share of the largest are not hair."""
PATCH = 1 / 40
"""Size of the neighbourhood in which streaks must be dense to be hair, as a share of the photograph's longer side."""
LEAST_STRENGTH = 0.65
"""Smallest density of streaks in hair, as a share of that in the densest places."""
DARKEST = 0.02
"""Added to brightness before its logarithm, so that noise in black areas does not look like streaks."""
CROP_MARGIN = 24
"""Width of the border around the hair that is filtered with it, pixels."""


@dataclass(frozen=True)
class Features:
    """One view, prepared for matching.

    Attributes:
        camera: the view's camera.
        texture: (c cos 2a, c sin 2a, c, brightness), with a the orientation and c its confidence.
        hair: which pixels are hair.
        silhouette: hair and pixels that may be hair, for the hull: a thin stray hair must not be carved away.
    """

    camera: Camera
    texture: Float[Tensor, "height width 4"]
    hair: Bool[Tensor, "height width"]
    silhouette: Bool[Tensor, "height width"]

    @property
    def box(self) -> Float[Tensor, "4"]:
        """Left, top, right and bottom of the hair, pixels."""
        row, column = torch.nonzero(self.hair, as_tuple=True)
        edges = [column.min(), row.min(), column.max() + 1, row.max() + 1]
        return torch.stack(edges).float()


def view_features(
    camera: Camera,
    image: Float[Tensor, "height width 3"],
    mask: Float[Tensor, "height width"] | None,
    config: OrientationConfig,
    brightness_blur: float = 0.7,
) -> tuple[Features, OrientationMap]:
    """Compute orientation and brightness of a view, and its pixels of hair.

    Without a mask, hair is where the orientation is confident and strong.

    Args:
        camera: the view's camera.
        image: the photograph, sRGB-encoded.
        mask: coverage of hair, if known.
        config: settings of the orientation filters.
        brightness_blur: standard deviation, in pixels, of the blur of brightness: sensor and path-tracing noise is
            white, streaks are not.

    Returns:
        The matcher's input, and the full orientation map.
    """
    brightness = luma(image)
    seen = orientation_map(brightness, config) if mask is None else _cropped(brightness, mask, config)
    if mask is None:
        # Streaks are shading, proportional to the hair's colour; those of dark hair show only in the logarithm.
        hair = hair_pixels(orientation_map(torch.log(brightness + DARKEST), config))
        silhouette = torch.ones_like(hair)
    else:
        hair = mask > 0.3
        silhouette = widen(mask, 1) > 0.2
    # The doubled angle is smooth across 0 and pi, so the texture may be interpolated.
    texture = torch.stack(
        [
            seen.confidence * torch.cos(2 * seen.angle),
            seen.confidence * torch.sin(2 * seen.angle),
            seen.confidence,
            gaussian_blur(brightness, brightness_blur),
        ],
        dim=-1,
    )
    return Features(camera, texture, hair, silhouette), seen


def _cropped(
    brightness: Float[Tensor, "height width"], mask: Float[Tensor, "height width"], config: OrientationConfig
) -> OrientationMap:
    """Orientation around the hair only; zero confidence elsewhere."""
    row, column = torch.nonzero(mask > 0.1, as_tuple=True)
    full = OrientationMap(*(torch.zeros_like(brightness) for _ in range(3)))
    if len(row) == 0:
        return full
    top, left = max(int(row.min()) - CROP_MARGIN, 0), max(int(column.min()) - CROP_MARGIN, 0)
    part = slice(top, int(row.max()) + CROP_MARGIN), slice(left, int(column.max()) + CROP_MARGIN)
    seen = orientation_map(brightness[part], config)
    full.angle[part], full.confidence[part], full.energy[part] = seen.angle, seen.confidence, seen.energy
    return full


def hair_pixels(seen: OrientationMap) -> Bool[Tensor, "height width"]:
    """Mark pixels around which streaks are dense and share one direction.

    The square root of their strength is averaged, so that many streaks count more than one strong edge, such as a
    collar.
    """
    sigma = PATCH * max(seen.angle.shape)
    smooth = gaussian_blur((seen.energy * seen.confidence).clamp(min=0).sqrt(), sigma)
    coherent = gaussian_blur(seen.confidence, sigma)
    positive = smooth[smooth > 0]
    if len(positive) == 0:
        return torch.zeros_like(smooth, dtype=torch.bool)
    strong = LEAST_STRENGTH * torch.quantile(positive[:: max(1, len(positive) // 100_000)], 0.98)
    found = ((smooth > strong) & (coherent > LEAST_COHERENCE)).cpu().numpy().astype(np.uint8)
    closed = cv2.morphologyEx(found, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    count, label, statistics, _ = cv2.connectedComponentsWithStats(closed)
    area = statistics[:, cv2.CC_STAT_AREA].copy()
    area[0] = 0
    large = np.nonzero(area > LEAST_SHARE * area.max())[0] if count > 1 else np.zeros(0, int)
    return torch.from_numpy(np.isin(label, large)).to(smooth.device)


def ray_angle(camera: Camera) -> float:
    """Angle covered by a pixel in the middle of the image, radians."""
    return math.atan(camera.footprint(1.0))
