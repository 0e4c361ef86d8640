"""A ball as the head, with combed hair, photographed by our own rasteriser: small enough to fit in seconds."""

import json
import math
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch
import trimesh

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.flow.field import FlowConfig
from neural_strands.flow.hair_flow import InitialConfig
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import directions
from neural_strands.model.hair_model import HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.surround.body import SurroundConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles

RADIUS = 0.09
SIDE = 64


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)


def combed_strands(count=400, points=20) -> torch.Tensor:
    """Strands from the upper half of the ball that follow it and hang: closed forms, random only by a fixed seed."""
    random = torch.Generator().manual_seed(3)
    azimuth = 2 * math.pi * torch.rand(count, generator=random)
    start = torch.rand(count, generator=random) * 0.9 + 0.1
    along = torch.linspace(0, 1, points)
    polar = start[:, None] + 0.8 * along
    radius = RADIUS + 0.001 + 0.012 * along.sqrt()
    direction = torch.stack(
        [polar.sin() * azimuth[:, None].sin(), polar.cos(), polar.sin() * azimuth[:, None].cos()], dim=-1
    )
    return radius[None, :, None] * direction


def cameras(count) -> list[Camera]:
    found = []
    for k in range(count):
        angle = 2 * math.pi * k / count
        eye = torch.tensor([0.7 * math.sin(angle), 0.35, 0.7 * math.cos(angle)])
        found.append(Camera.look_at(eye, torch.zeros(3), 170.0, (SIDE, SIDE), f"{k:03d}"))
    return found


def write_capture(folder: Path, views=6, with_masks=True, shaded=False) -> torch.Tensor:
    """Photographs, masks, head and ground truth in the layout of a capture; returns the true strands.

    With `shaded`, each strand has a brightness of its own, so that stereo finds segments.
    """
    made, strands = _made_capture(views, with_masks, shaded)
    shutil.copytree(made.name, folder, dirs_exist_ok=True)
    return strands.clone()


@cache
def _made_capture(views: int, with_masks: bool, shaded: bool) -> tuple[TemporaryDirectory, torch.Tensor]:
    """A capture that is made once and then copied, because many tests need the same one."""
    made = TemporaryDirectory()
    return made, _photograph(Path(made.name), views, with_masks, shaded)


def _photograph(folder: Path, views: int, with_masks: bool, shaded: bool) -> torch.Tensor:
    strands, head = combed_strands(), ball()
    vertices, faces = torch.from_numpy(head.vertices).float(), torch.from_numpy(head.faces).long()
    (folder / "images").mkdir(parents=True)
    (folder / "masks").mkdir()
    brightness = 0.5 + 2.5 * torch.rand(len(strands), 1, generator=torch.Generator().manual_seed(5))
    frames = []
    for camera in cameras(views):
        body = rasterise_triangles(vertices, faces, camera)
        segment = rasterise_lines(strands, camera, body.depth).segment
        hair = segment >= 0
        image = torch.full((SIDE, SIDE, 3), 0.6)
        image[body.face >= 0] = torch.tensor([0.8, 0.6, 0.5])
        image[hair] = torch.tensor([0.3, 0.2, 0.1])
        if shaded:
            image[hair] *= brightness[segment[hair] // (strands.shape[1] - 1)]
        picture = (image * 255).round().byte().numpy()
        cv2.imwrite(str(folder / "images" / f"{camera.name}.png"), np.ascontiguousarray(picture[..., ::-1]))
        cv2.imwrite(str(folder / "masks" / f"{camera.name}.png"), hair.byte().mul(255).numpy())
        frame = {
            "file_path": f"images/{camera.name}.png",
            "transform_matrix": camera.opengl_camera_to_world.tolist(),
        }
        frames.append(frame | ({"mask_path": f"masks/{camera.name}.png"} if with_masks else {}))
    if not with_masks:
        for path in (folder / "masks").iterdir():
            path.unlink()
        (folder / "masks").rmdir()
    shared = {"camera_model": "OPENCV", "w": SIDE, "h": SIDE, "fl_x": 170.0, "fl_y": 170.0, "cx": 32.0, "cy": 32.0}
    (folder / "transforms.json").write_text(json.dumps({**shared, "frames": frames}))
    head.export(folder / "head.obj")
    scalp = np.nonzero(head.triangles_center[:, 1] > 0.02)[0]
    (folder / "scalp_faces.json").write_text(json.dumps(scalp.tolist()))
    unit = 1e-5
    np.savez(folder / "ground_truth.npz", strands=(strands / unit).round().short().numpy(), unit=unit)
    return strands


def true_segments(strands: torch.Tensor) -> LineSegments:
    """The strands themselves, as segments of all their points."""
    count, points, _ = strands.shape
    return LineSegments(
        strands.reshape(-1, 3),
        directions(strands).reshape(-1, 3),
        torch.ones(count * points),
        torch.arange(count).repeat_interleave(points),
    )


def tiny_config(**changes) -> FitConfig:
    model = HairModelConfig(
        textures=ScalpTextureConfig(shape_size=32, appearance_size=32),
        unet=UNetConfig(widths=(8, 8)),
        surround=SurroundConfig(background_texture=32, background_directions=24),
        points=24,
        supersample=1,
    )
    config = FitConfig(
        steps=12,
        strands=200,
        strands_per_step=80,
        step_points=12,
        targets_per_step=500,
        crop=48,
        shape_every=2,
        model=model,
        schedule=ScheduleConfig(widest_blur=2.0, geometry_only=0.5, warmup=2),
        # An eighth of the voxels of the default: there, tracing takes longer than all steps together.
        initial=InitialConfig(flow=FlowConfig(spacing=0.004)),
    )
    return replace(config, **changes)
