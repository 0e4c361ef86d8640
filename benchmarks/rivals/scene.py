"""Converts a capture for programs that fit splats: the person in front of a plain surround, and initial points.

Splats must also represent what is behind the person. From few views they place it arbitrarily, held-out views suffer,
and the comparison would be one of backgrounds. So the masks are used to replace the surround by the plain colour over
which the program blends splats, and the rival need not learn it. In the held-out views, the photograph's own surround
is put back.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from neural_strands.capture.writer import CaptureWriter
from neural_strands.foundation.files import atomic_file, write_json
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.views import View
from neural_strands.pictures.encoding import to_bytes
from neural_strands.raster.gaussian_blur import gaussian_blur
from neural_strands.raster.triangles import rasterise_triangles

FINER = 3
"""Samples of the head's outline in a pixel, along each axis."""
BARE = 0.02
"""Coverage up to which a pixel shows the surround alone."""
SPREAD = 8.0
"""Standard deviation, pixels, of the blur by which the surround is continued behind the person's outline."""
FAINT = 1e-4
"""Share of the surround's mean where the blur reaches nothing of it."""


def person_coverage(view: View, head: Mesh) -> Float[Tensor, "height width"]:
    """How much of each pixel the person covers: hair, and the mask of the person or else the head's mesh."""
    if view.person_mask is not None:
        body = view.person_mask
    else:
        fine = view.camera.resized(FINER * view.camera.width, FINER * view.camera.height)
        shown = (rasterise_triangles(head.vertices, head.faces, fine).face >= 0).float()
        body = torch.nn.functional.avg_pool2d(shown[None], FINER)[0]
    return body if view.hair_mask is None else torch.maximum(body, view.hair_mask)


def surround(view: View, person: Float[Tensor, "height width"]) -> Float[Tensor, "height width 3"]:
    """The photograph without the person, linear: the surround beside the outline is continued behind it."""
    light = to_linear(view.image)
    bare = (person <= BARE).float()
    mean = (bare[..., None] * light).sum(dim=(0, 1)) / bare.sum().clamp(min=1)
    sums = gaussian_blur(torch.cat([bare[..., None] * light, bare[..., None]], dim=-1).permute(2, 0, 1), SPREAD)
    near = (sums[:3] + FAINT * mean[:, None, None]) / (sums[3:] + FAINT)
    return torch.where(bare[..., None] > 0, light, near.permute(1, 2, 0))


def over_plain(view: View, head: Mesh, plain: Float[Tensor, "3"]) -> Float[Tensor, "height width 3"]:
    """The photograph with a plain colour in place of its surround, encoded.

    At the outline, the surround's light is taken out of the photograph in linear light, and the person's own colour is
    laid over the plain one as splats are: by encoded values.
    """
    person = person_coverage(view, head)
    behind = surround(view, person)
    covered = person[..., None]
    own = (to_linear(view.image) - (1 - covered) * behind) / covered.clamp(min=BARE)
    return torch.where(covered > BARE, covered * to_srgb(own.clamp(0, 1)) + (1 - covered) * plain, plain)


def over_surround(
    colour: Float[Tensor, "height width 3"], alpha: Float[Tensor, "height width"], view: View, head: Mesh
) -> Float[Tensor, "height width 3"]:
    """Splats in front of the surround of a photograph, encoded: the inverse of `over_plain`.

    Args:
        colour: encoded, multiplied by the opacity.
        alpha: opacity.
        view: the photograph whose surround is taken.
        head: stands for the person where there is no mask of it.
    """
    behind = surround(view, person_coverage(view, head))
    covered = alpha[..., None]
    own = to_linear((colour / covered.clamp(min=1e-6)).clamp(0, 1))
    return to_srgb(covered * own + (1 - covered) * behind).clamp(0, 1)


def centred(camera: Camera) -> Rectangle:
    """The largest part of a view whose middle is the principal point: some programs look for it there."""

    def part(length: int, middle: float) -> tuple[int, int]:
        side = min(round(2 * min(middle, length - middle)), length)
        return (length - side if middle > length / 2 else 0), side

    left, width = part(camera.width, float(camera.intrinsics[0, 2]))
    top, height = part(camera.height, float(camera.intrinsics[1, 2]))
    return Rectangle(left, top, width, height)


@dataclass(frozen=True)
class SeedPoints:
    """Points that splats start from.

    Attributes:
        points: world metres.
        colours: encoded.
    """

    points: Float[Tensor, "point 3"]
    colours: Float[Tensor, "point 3"]


def seed_points(
    segments: LineSegments, head: Mesh, views: Sequence[View], counts: tuple[int, int], random: torch.Generator
) -> SeedPoints:
    """Points of the hair and of the head, each of the colour of the photograph that faces it.

    Args:
        segments: of the hair, from the same views.
        head: its surface is sampled evenly by area.
        views: the photographs that the rival may see.
        counts: how many points of the hair, at most, and of the head.
        random: chooses them.
    """
    hair = segments.points[torch.randperm(len(segments), generator=random)[: counts[0]]]
    face = torch.multinomial(face_areas(head), counts[1], replacement=True, generator=random)
    first, second = torch.rand(2, counts[1], 1, generator=random)
    weights = torch.cat([1 - first.sqrt(), first.sqrt() * (1 - second), first.sqrt() * second], dim=1)
    skin = (weights[..., None] * head.corners()[face]).sum(dim=1)
    points = torch.cat([hair, skin])
    outward = torch.nn.functional.normalize(points - head.vertices.mean(dim=0), dim=-1)
    colours, facing = torch.full_like(points, 0.5), torch.full((len(points),), -1.0)
    for view in views:
        pixels, _ = view.camera.project(points)
        column, row = pixels.floor().long().unbind(-1)
        inside = (column >= 0) & (column < view.camera.width) & (row >= 0) & (row < view.camera.height)
        towards = torch.nn.functional.normalize(view.camera.position - points, dim=-1)
        cosine = torch.where(inside, (towards * outward).sum(dim=-1), -1.0)
        better = cosine > facing
        colours[better] = view.image[row[better], column[better]]
        facing = torch.where(better, cosine, facing)
    return SeedPoints(points, colours)


def write_points(path: Path, seeds: SeedPoints) -> None:
    """Write points as a binary PLY with colours."""
    table = np.zeros(len(seeds.points), [*((axis, "<f4") for axis in "xyz"), ("rgb", "u1", 3)])
    for number, axis in enumerate("xyz"):
        table[axis] = seeds.points[:, number].numpy()
    colours: UInt8[np.ndarray, "point 3"] = to_bytes(seeds.colours)
    table["rgb"] = colours
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"property uchar {colour}" for colour in ("red", "green", "blue")]
    with atomic_file(path) as temporary:
        temporary.write_bytes("\n".join([*lines, "end_header", ""]).encode() + table.tobytes())


def write_scene(
    folder: Path,
    views: Sequence[View],
    head: Mesh,
    plain: Float[Tensor, "3"],
    seeds: SeedPoints,
    negative: bool = False,
) -> None:
    """Write the folder that a splat program reads: photographs before a plain surround, cameras, and first points.

    Args:
        folder: to write.
        views: photographs.
        head: stands for the person where there is no mask of it.
        plain: colour of the surround, encoded.
        seeds: the first points.
        negative: whether the negatives of the photographs are written, surround included.
    """
    writer, cameras = CaptureWriter(folder), []
    for view in views:
        part = centred(view.camera)
        shown = view.cropped(part)
        # Without folders in its name, a photograph is found by every reader.
        camera = replace(shown.camera, name=Path(view.camera.name.replace("/", "_")).with_suffix(".png").name)
        picture = part.of(over_plain(view, head, plain))
        writer.write_view(camera, 1 - picture if negative else picture)
        cameras.append(camera)
    write_points(folder / "points.ply", seeds)
    writer.finish(cameras)
    path = folder / "transforms.json"
    write_json(path, {**json.loads(path.read_text()), "ply_file_path": "points.ply"})
