"""A large capture for timing, drawn in seconds: `python benchmarks/speed/drawn_capture.py OUT [--device cuda]`.

The wavy style on the built-in mannequin, in front of grey, drawn by our own rasteriser, with masks, head and true
strands. Each strand has a brightness of its own and shines where it is square to the view, so that stereo finds lines;
there is no shadow and no noise. Times measured on it count, scores of pictures do not.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro
from torch import Tensor

from neural_strands.capture.writer import CaptureWriter, quantised
from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.foundation.progress import track
from neural_strands.foundation.srgb import to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands, directions
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis.dome import DomeConfig, dome
from neural_strands.synthesis.groom import make_groom
from neural_strands.synthesis.styles import MELANIN, STYLES

HAIR, SKIN, BACKGROUND = (0.20, 0.12, 0.07), (0.55, 0.40, 0.32), (0.3, 0.3, 0.3)
"""Colours, linear."""
WIDTH = 1.2e-4
"""Metres."""
FINER = 3
"""Line pixels for each image pixel, along each axis."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    views: int = 60
    """Number of photographs."""
    resolution: int = 1024
    """Their side, pixels."""
    strands: int = 30_000
    """Number of strands."""
    device: DeviceName = "auto"
    """Device."""


def drawn(points: Tensor, brightness: Tensor, head: Mesh, camera: Camera) -> tuple[Tensor, Tensor]:
    """A picture, linear, and the coverage of hair."""
    fine = camera.resized(FINER * camera.width, FINER * camera.height)
    body = rasterise_triangles(head.vertices, head.faces, fine)
    segment = rasterise_lines(points, fine, body.depth, LineConfig(width=WIDTH)).segment
    hair, count = segment >= 0, points.shape[1] - 1
    strand, along = segment[hair] // count, segment[hair] % count
    seen = torch.nn.functional.normalize(points[strand, along] - camera.position.to(points), dim=-1)
    across = (directions(points)[strand, along] * seen).sum(-1).square()
    picture = points.new_tensor(BACKGROUND).repeat(fine.height, fine.width, 1)
    picture[body.face >= 0] = points.new_tensor(SKIN)
    picture[hair] = points.new_tensor(HAIR) * (brightness[strand] * (1.5 - across))[:, None]
    stacked = torch.cat([picture, hair[..., None].to(picture)], dim=-1).movedim(-1, 0)[None]
    small = torch.nn.functional.avg_pool2d(stacked, FINER)[0].movedim(0, -1)
    return small[..., :3], small[..., 3]


def main(given: Arguments) -> None:
    """Draw the capture."""
    device, random = pick_device(given.device), torch.Generator().manual_seed(0)
    head = mannequin()
    strands = quantised(make_groom(head, STYLES["wavy"], MELANIN["brown"], given.strands, random))
    brightness = (0.4 + 1.6 * torch.rand(given.strands, generator=random)).to(device)
    writer, points, mesh = CaptureWriter(given.out), strands.points.to(device), head.mesh.to(device)
    writer.write_head(head.mesh, head.scalp_faces)
    writer.write_ground_truth(Strands(strands.points))
    cameras = dome(strands.points, DomeConfig(given.views, given.resolution))
    for camera in track(cameras, "drawing"):
        picture, coverage = drawn(points, brightness, mesh, camera.to(device))
        writer.write_view(camera, to_srgb(picture), coverage)
    writer.finish(cameras)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
