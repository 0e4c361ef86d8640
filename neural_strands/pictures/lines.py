"""Lines in space as pictures: strands and segments, by default coloured by direction, on a head or a photograph."""

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh, face_normals
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles

SKIN = (0.80, 0.76, 0.73)
"""Colour of the head."""
PAPER = 1.0
"""Brightness behind lines and head."""
SLACK = 0.01
"""Depth behind the head's surface up to which a segment is visible, as a share of its depth: roots scatter around the
surface."""
BLOCK, LAYER = 8, 0.03
"""Side of a photograph's blocks, pixels; each block shows the segment nearest to the camera, and those behind it by at
most this share of their depth."""
DIMMED = 110
"""Level, of 255, to which white is dimmed in a photograph below segments."""


def lines_picture(
    lines: Float[Tensor, "strand point 3"],
    camera: Camera,
    head: Mesh | None = None,
    colours: Float[Tensor, "strand point 3"] | None = None,
) -> Float[Tensor, "height width 3"]:
    """Strands (or segments, as strands of two points) on a shaded head.

    Args:
        lines: positions, world metres; there may be none.
        camera: the view.
        head: hides what is behind it.
        colours: sRGB at each point; None colours by direction.
    """
    fine = camera.resized(2 * camera.width, 2 * camera.height)
    image = torch.full((fine.height, fine.width, 3), PAPER, device=lines.device)
    depth = None
    if head is not None:
        seen = rasterise_triangles(head.vertices, head.faces, fine)
        depth = seen.depth
        facing = (face_normals(head) @ -camera.rotation[2]).abs()
        shaded = 0.35 + 0.65 * facing[seen.face.clamp(min=0)]
        image = torch.where((seen.face >= 0)[..., None], shaded[..., None] * image.new_tensor(SKIN), image)
    buffer = rasterise_lines(lines, fine, depth)
    drawn = buffer.segment >= 0
    per_strand, segment = lines.shape[1], buffer.segment[drawn]
    start = segment + segment // (per_strand - 1)
    flat = (lines if colours is None else colours).reshape(-1, 3)
    first, second = flat[start], flat[start + 1]
    if colours is None:
        ink = direction_colour(F.normalize(second - first, dim=-1))
    else:
        ink = torch.lerp(first, second, buffer.position[drawn][:, None])
    image[drawn] = ink
    return F.avg_pool2d(image.permute(2, 0, 1)[None], 2)[0].permute(1, 2, 0)


def lines_over_photograph(
    photograph: Float[Tensor, "height width 3"], lines: Float[Tensor, "strand point 3"], camera: Camera, head: Mesh
) -> Float[Tensor, "height width 3"]:
    """Strands, coloured by direction, drawn semi-transparently over a photograph."""
    drawn = lines_picture(lines, camera, head)
    covered = rasterise_lines(lines, camera, rasterise_triangles(head.vertices, head.faces, camera).depth).segment >= 0
    return torch.where(covered[..., None], 0.35 * photograph + 0.65 * drawn, photograph)


def segments_over_photograph(
    photograph: Float[Tensor, "height width 3"], segments: LineSegments, camera: Camera, head: Mesh | None = None
) -> Float[Tensor, "height width 3"]:
    """The segments nearest to the camera and not behind the head, coloured by direction, over a dimmed photograph.

    They are drawn on the CPU.
    """
    segments, camera = segments.to("cpu"), camera.to("cpu")
    samples = (photograph.cpu().numpy() * DIMMED).astype(np.uint8)
    pixel, depth = camera.project(segments.points)
    same = segments.segment_id[1:] == segments.segment_id[:-1]
    first = torch.nonzero(same & (depth[1:] > 0) & (depth[:-1] > 0)).squeeze(1)
    first = first[_visible(pixel[first], depth[first], camera, None if head is None else head.to("cpu"))]
    first = first[torch.argsort(depth[first], descending=True)]
    start = (pixel[first] * 16).round().int().cpu().numpy()
    end = (pixel[first + 1] * 16).round().int().cpu().numpy()
    colour = direction_colour(segments.directions[first]).clamp(0, 1).cpu().numpy() * 255
    for a, b, c in zip(start, end, colour, strict=True):
        cv2.line(samples, a.tolist(), b.tolist(), c.tolist(), 1, cv2.LINE_AA, 4)
    return torch.from_numpy(samples).float() / 255


def direction_colour(directions: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Red, green and blue of unit directions: their components, from [-1, 1] to [0, 1]."""
    return 0.5 + 0.5 * directions


def _visible(
    pixel: Float[Tensor, "point 2"], depth: Float[Tensor, " point"], camera: Camera, head: Mesh | None
) -> Bool[Tensor, " point"]:
    """Mark points in the image that are about the nearest in their block of pixels, and not behind the head."""
    cell = (pixel / BLOCK).floor().long()
    width, height = camera.width // BLOCK + 1, camera.height // BLOCK + 1
    inside = (cell >= 0).all(-1) & (cell[:, 0] < width) & (cell[:, 1] < height)
    key = torch.where(inside, cell[:, 1] * width + cell[:, 0], width * height)
    nearest = torch.full((width * height + 1,), float("inf"), device=depth.device)
    nearest.scatter_reduce_(0, key, depth, "amin")
    shown = inside & (depth < nearest[key] + LAYER * depth)
    if head is None:
        return shown
    surface = rasterise_triangles(head.vertices, head.faces, camera).depth
    column = pixel[:, 0].long().clamp(0, camera.width - 1)
    row = pixel[:, 1].long().clamp(0, camera.height - 1)
    return shown & (depth < (1 + SLACK) * surface[row, column])
