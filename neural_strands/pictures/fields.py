"""Per-pixel quantities as colours: orientation, depth, differences."""

import cv2
import matplotlib as mpl
import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

WHEEL = 1 / 8
"""Radius of the colour wheel in an orientation picture, as a share of the shorter side."""


def orientation_picture(texture: Float[Tensor, "height width 4"]) -> Float[Tensor, "height width 3"]:
    """Orientation as hue (pi makes a full turn), confidence as brightness, with a wheel in the corner as a key.

    Args:
        texture: (c cos 2a, c sin 2a, c, brightness), with a the orientation and c its confidence.
    """
    cosine, sine, confidence, _ = texture.cpu().numpy().transpose(2, 0, 1)
    angle = 0.5 * np.arctan2(sine, cosine)
    value = np.clip(confidence / max(float(np.quantile(confidence, 0.98)), 1e-6), 0, 1)
    size = int(min(angle.shape) * WHEEL)
    y, x = np.mgrid[-size : size + 1, -size : size + 1]
    wheel = np.hypot(x, y) <= size
    angle[: 2 * size + 1, : 2 * size + 1][wheel] = np.arctan2(y, x)[wheel]
    value[: 2 * size + 1, : 2 * size + 1][wheel] = 1.0
    hue = (np.mod(angle, np.pi) / np.pi * 180).astype(np.uint8)
    full = np.full_like(hue, 255)
    samples = cv2.cvtColor(np.stack([hue, full, (value * 255).astype(np.uint8)], axis=-1), cv2.COLOR_HSV2RGB)
    return _in_unit(samples)


def depth_picture(
    pixel: Int[Tensor, "line 2"], depth: Float[Tensor, " line"], size: tuple[int, int]
) -> Float[Tensor, "height width 3"]:
    """Depth at some pixels, from near (blue) to far (red), on black.

    Args:
        pixel: columns and rows; if only every second column and row occurs, each pixel fills its 2 x 2 block.
        depth: metres.
        size: height and width of the picture.
    """
    height, width = size
    samples = np.zeros((height, width, 3), np.uint8)
    if len(depth) == 0:
        return _in_unit(samples)
    metres, places = depth.cpu().numpy(), pixel.cpu().numpy()
    low, high = np.quantile(metres, [0.02, 0.98])
    level = (np.clip((metres - low) / max(high - low, 1e-9), 0, 1) * 255).astype(np.uint8)
    colour = cv2.applyColorMap(level[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]
    stride = 2 if ((places % 2) == places[0] % 2).all() else 1
    for down in range(stride):
        for right in range(stride):
            row = np.minimum(places[:, 1] + down, height - 1)
            samples[row, np.minimum(places[:, 0] + right, width - 1)] = colour
    return _in_unit(samples)


def difference_picture(
    rendered: Float[Tensor, "height width 3"], truth: Float[Tensor, "height width 3"], gain: float = 4.0
) -> Float[Tensor, "height width 3"]:
    """Mean absolute difference over the channels, times `gain`, as a heat map."""
    error = (rendered - truth).abs().mean(dim=-1).mul(gain).clamp(0, 1).cpu().numpy()
    return torch.from_numpy(mpl.colormaps["inferno"](error)[..., :3].astype(np.float32))


def _in_unit(samples: np.ndarray) -> Float[Tensor, "height width 3"]:
    """8-bit samples as values in [0, 1]."""
    return torch.from_numpy(samples).float() / 255
