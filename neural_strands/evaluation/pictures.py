"""Pictures for people: strands and segments over a photograph, differences, curves, as PNG bytes."""

import io
from collections.abc import Mapping, Sequence

import cv2
import matplotlib as mpl
import numpy as np
import torch
from jaxtyping import Float
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, face_normals
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles

SKIN = (0.80, 0.76, 0.73)
"""Colour of the head in pictures of geometry."""
PAPER = 1.0
"""Brightness behind pictures of geometry."""


def png(image: Float[Tensor, "height width channel"]) -> bytes:
    """Encode an sRGB image in [0, 1]."""
    array = image.detach().clamp(0, 1).mul(255).round().byte().cpu().numpy()
    encoded, data = cv2.imencode(".png", np.ascontiguousarray(array[..., ::-1]))
    if not encoded:
        raise ValueError(f"an image of shape {tuple(image.shape)} could not be encoded as PNG")
    return data.tobytes()


def strip(frames: Sequence[Float[Tensor, "height width 3"]], quality: int = 85) -> bytes:
    """Encode sRGB images of one size, in [0, 1], as one WebP, each below the one before."""
    stacked = torch.cat(list(frames)).detach().clamp(0, 1).mul(255).round().byte().cpu().numpy()
    settings = [cv2.IMWRITE_WEBP_QUALITY, quality]
    encoded, data = cv2.imencode(".webp", np.ascontiguousarray(stacked[..., ::-1]), settings)
    if not encoded:
        raise ValueError(f"images of shape {tuple(stacked.shape)} in all could not be encoded as WebP")
    return data.tobytes()


def difference(
    rendered: Float[Tensor, "height width 3"], truth: Float[Tensor, "height width 3"], gain: float = 4.0
) -> Float[Tensor, "height width 3"]:
    """Mean absolute difference over channels as a heat map, `gain` times."""
    error = (rendered - truth).abs().mean(dim=-1).mul(gain).clamp(0, 1).numpy()
    return torch.from_numpy(mpl.colormaps["inferno"](error)[..., :3].astype(np.float32))


def geometry_picture(
    lines: Float[Tensor, "strand point 3"], camera: Camera, head: Mesh | None = None
) -> Float[Tensor, "height width 3"]:
    """Strands (or segments, as strands of two points) on a shaded head, coloured by their direction in space."""
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
    per_strand = lines.shape[1]
    segment = buffer.segment.clamp(min=0)
    start = segment + segment // (per_strand - 1)
    flat = lines.reshape(-1, 3)
    along = torch.nn.functional.normalize(flat[start + 1] - flat[start], dim=-1)
    image = torch.where(drawn[..., None], 0.5 + 0.5 * along, image)
    return torch.nn.functional.avg_pool2d(image.permute(2, 0, 1)[None], 2)[0].permute(1, 2, 0)


def overlay(
    photograph: Float[Tensor, "height width 3"], lines: Float[Tensor, "strand point 3"], camera: Camera, head: Mesh
) -> Float[Tensor, "height width 3"]:
    """The strands, by direction, laid half over a photograph."""
    drawn = geometry_picture(lines, camera, head)
    covered = rasterise_lines(lines, camera, rasterise_triangles(head.vertices, head.faces, camera).depth).segment >= 0
    return torch.where(covered[..., None], 0.35 * photograph + 0.65 * drawn, photograph)


def curves(series: Mapping[str, Sequence[tuple[float, float]]], title: str) -> bytes:
    """Loss curves on a logarithmic axis, as PNG; what is zero is left out."""
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, points in series.items():
        shown = [(x, y) for x, y in points if y > 0]
        if shown:
            axes.plot(*zip(*shown, strict=True), label=name, linewidth=1.2)
    axes.set_yscale("log")
    axes.set_xlabel("step")
    axes.set_title(title)
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", fontsize=8)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()
