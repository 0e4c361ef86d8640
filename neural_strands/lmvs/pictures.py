"""A picture per stage: orientation as a colour wheel, depth, and segments over the photograph."""

from pathlib import Path

import cv2
import numpy as np
import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.features import Features
from neural_strands.lmvs.patchmatch import LineMap
from neural_strands.lmvs.search_range import head_distance

SKIN = 0.01
"""How far behind the head's surface hair still shows, as a share of its distance."""


def orientation_picture(features: Features) -> np.ndarray:
    """Orientation as hue (pi makes a full turn), confidence as brightness, a wheel in the corner; BGR bytes."""
    texture = features.texture.cpu().numpy()
    angle = 0.5 * np.arctan2(texture[..., 1], texture[..., 0])
    value = np.clip(texture[..., 2] / max(float(np.quantile(texture[..., 2], 0.98)), 1e-6), 0, 1)
    size = min(angle.shape) // 8
    y, x = np.mgrid[-size : size + 1, -size : size + 1]
    ring = np.hypot(x, y) <= size
    angle[: 2 * size + 1, : 2 * size + 1][ring] = np.arctan2(y, x)[ring]
    value[: 2 * size + 1, : 2 * size + 1][ring] = 1.0
    hue = (np.mod(angle, np.pi) / np.pi * 180).astype(np.uint8)
    full = np.full_like(hue, 255)
    return cv2.cvtColor(np.stack([hue, full, (value * 255).astype(np.uint8)], axis=-1), cv2.COLOR_HSV2BGR)


def depth_picture(camera: Camera, lines: LineMap) -> np.ndarray:
    """Depth from near (blue) to far (red); BGR bytes."""
    picture = np.zeros((camera.height, camera.width, 3), np.uint8)
    if len(lines.depth) == 0:
        return picture
    depth, pixel = lines.depth.cpu().numpy(), lines.pixel.cpu().numpy()
    low, high = np.quantile(depth, [0.02, 0.98])
    level = (np.clip((depth - low) / max(high - low, 1e-9), 0, 1) * 255).astype(np.uint8)
    colour = cv2.applyColorMap(level[:, None], cv2.COLORMAP_TURBO)[:, 0]
    stride = 2 if len(pixel) and ((pixel % 2) == pixel[0] % 2).all() else 1
    for dy in range(stride):
        for dx in range(stride):
            rows = np.minimum(pixel[:, 1] + dy, camera.height - 1)
            picture[rows, np.minimum(pixel[:, 0] + dx, camera.width - 1)] = colour
    return picture


def segments_picture(
    camera: Camera, image: Float[Tensor, "height width 3"], segments: LineSegments, head: wp.Mesh | None
) -> np.ndarray:
    """Segments on the side that faces the camera and before the head, coloured by 3D direction; BGR bytes.

    The photograph lies darkened below them.
    """
    picture = (image.cpu().numpy()[..., ::-1] * 110).astype(np.uint8).copy()
    pixel, depth = camera.project(segments.points)
    same = segments.segment_id[1:] == segments.segment_id[:-1]
    first = torch.nonzero(same & (depth[1:] > 0) & (depth[:-1] > 0)).squeeze(1)
    front = _in_front(pixel[first], depth[first], camera) & _before_head(segments.points[first], camera, head)
    first = first[front]
    first = first[torch.argsort(depth[first], descending=True)]
    start = (pixel[first] * 16).round().int().cpu().numpy()
    end = (pixel[first + 1] * 16).round().int().cpu().numpy()
    colour = (segments.directions[first] * 0.5 + 0.5).clamp(0, 1).cpu().numpy() * 255
    for a, b, c in zip(start, end, colour, strict=True):
        cv2.line(picture, a.tolist(), b.tolist(), c.tolist(), 1, cv2.LINE_AA, 4)
    return picture


def _before_head(points: Float[Tensor, "point 3"], camera: Camera, head: wp.Mesh | None) -> Tensor:
    """Points that the head does not hide; those just within its skin count, as roots scatter about it."""
    offset = points - camera.position
    distance = offset.norm(dim=-1)
    return distance < (1 + SKIN) * head_distance(camera, offset / distance[:, None], head)


def save_picture(path: Path, picture: np.ndarray) -> None:
    """Write BGR bytes as PNG."""
    with atomic_file(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", picture)[1].tobytes())


def _in_front(pixel: Float[Tensor, "point 2"], depth: Float[Tensor, " point"], camera: Camera) -> Tensor:
    """Points that are nearly the nearest within a block of pixels."""
    block = 8
    cell = (pixel / block).floor().long()
    width, height = camera.width // block + 1, camera.height // block + 1
    inside = (cell >= 0).all(-1) & (cell[:, 0] < width) & (cell[:, 1] < height)
    key = torch.where(inside, cell[:, 1] * width + cell[:, 0], width * height)
    nearest = torch.full((width * height + 1,), float("inf"), device=depth.device)
    nearest.scatter_reduce_(0, key, depth, "amin")
    return inside & (depth < nearest[key] + 0.03 * depth)
