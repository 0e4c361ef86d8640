"""Growth strokes of a user: polylines from root to tip, in world metres or drawn on a view."""

import json
from collections.abc import Sequence
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments

FIRST_HIT = 0.1
"""Quantile of the depths about a stroke's pixel that stands for the hair that was drawn on."""


def read_strokes(path: Path, cameras: Sequence[Camera], segments: LineSegments) -> list[Float[Tensor, "point 3"]]:
    """Read strokes; those drawn on a view are lifted onto the segments that it sees first.

    The file is JSON: a list of {"points": [[x, y, z], ...]} in world metres, or
    {"view": NAME, "points": [[x, y], ...]} in pixels of that view.

    Raises:
        InputError: the file cannot be read, names no view of the capture, or a stroke lies beside the hair.
    """
    try:
        entries = json.loads(path.read_text())
        polylines = [(entry.get("view"), torch.tensor(entry["points"], dtype=torch.float32)) for entry in entries]
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(
            f'{path}: expected a JSON list of strokes, each {{"points": [[x, y, z], ...]}} or with "view", came what '
            f"cannot be read ({error})."
        ) from error
    return [_stroke(path, number, *given, cameras, segments) for number, given in enumerate(polylines)]


def _stroke(
    path: Path, number: int, view: str | None, points: Tensor, cameras: Sequence[Camera], segments: LineSegments
) -> Float[Tensor, "point 3"]:
    """One stroke in world metres."""
    axes = 3 if view is None else 2
    if points.ndim != 2 or len(points) < 2 or points.shape[1] != axes or not torch.isfinite(points).all():
        raise InputError(
            f"{path}: stroke {number}: expected two or more points of {axes} finite numbers, came an array of shape "
            f"{tuple(points.shape)}."
        )
    if view is None:
        return points
    named = [camera for camera in cameras if camera.name == view]
    if not named:
        raise InputError(f"{path}: stroke {number}: expected the name of a view of the capture, came {view!r}.")
    return _lift(path, number, points, named[0], segments)


def _lift(path: Path, number: int, pixels: Tensor, camera: Camera, segments: LineSegments) -> Float[Tensor, "point 3"]:
    """Give a stroke's pixels the depth of the segments seen first about them."""
    seen, depth = camera.project(segments.points)
    reach = 0.01 * max(camera.width, camera.height)
    lifted = []
    for pixel in pixels:
        near = ((seen - pixel).norm(dim=-1) < reach) & (depth > 0)
        if near.any():
            lifted.append(camera.unproject(pixel, torch.quantile(depth[near], FIRST_HIT, interpolation="lower")))
    if len(lifted) < 2:
        raise InputError(
            f"{path}: stroke {number}: expected points on the hair seen by {camera.name}, came none there."
        )
    return torch.stack(lifted)
