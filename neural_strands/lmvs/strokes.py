"""Growth strokes drawn by a user: polylines from root to tip, in world metres or in pixels of a view."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.json_files import JsonValue, read_json
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments

FIRST_HIT = 0.1
"""Quantile of the depths around a stroke's pixel that serves as the depth of the hair."""


@dataclass(frozen=True)
class Stroke:
    """A stroke as it was drawn.

    Attributes:
        points: world metres, or pixels of the camera; root first.
        camera: the view that it was drawn on, or None for world metres.
        written: its points as read from the file, for error messages.
    """

    points: Float[Tensor, "point axis"]
    camera: Camera | None
    written: JsonValue


def read_strokes(path: Path, cameras: Sequence[Camera]) -> list[Stroke]:
    """Read strokes from JSON.

    The file contains a list of {"points": [[x, y, z], ...]} in world metres, or {"view": NAME, "points": [[x, y], ...]}
    in pixels of that view.

    Raises:
        InputError: the file cannot be read, has other contents, or names a view that is not in the capture.
    """
    document = read_json(path, "a list of strokes", 'write each as {"points": [[x, y, z], ...]}, or with "view"')
    return [_stroke(entry, cameras) for entry in document.elements()]


def _stroke(entry: JsonValue, cameras: Sequence[Camera]) -> Stroke:
    view, written = entry.optional("view"), entry.member("points")
    axes = 3 if view is None else 2
    points = torch.from_numpy(written.array(None, axes)).float()
    if len(points) < 2 or not torch.isfinite(points).all():
        raise written.refuse(f"two or more points of {axes} finite numbers")
    if view is None:
        return Stroke(points, None, written)
    name = view.text()
    named = next((camera for camera in cameras if camera.name == name), None)
    if named is None:
        raise view.refuse("the name of a view of the capture")
    return Stroke(points, named, written)


def lift_stroke(stroke: Stroke, segments: LineSegments) -> Float[Tensor, "point 3"]:
    """Lift a stroke drawn on a view to the depth of the nearest segments around its pixels.

    Returns:
        The stroke in world metres.

    Raises:
        InputError: fewer than two of its points lie on the hair.
    """
    camera = stroke.camera
    if camera is None:
        return stroke.points
    seen, depth = camera.project(segments.points)
    reach = 0.01 * max(camera.width, camera.height)
    lifted = []
    for pixel in stroke.points:
        near = ((seen - pixel).norm(dim=-1) < reach) & (depth > 0)
        if near.any():
            lifted.append(camera.unproject(pixel, torch.quantile(depth[near], FIRST_HIT, interpolation="lower")))
    if len(lifted) < 2:
        raise stroke.written.refuse("points on the hair that the view sees")
    return torch.stack(lifted)
