"""Photographs of the built-in head with a cap of hair, with cameras and landmarks, in a frame and unit of their own."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from neural_strands.capture.writer import CaptureWriter
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.builtin import builtin_template, face_paint
from neural_strands.preparation.head.fit import KnownSize
from neural_strands.preparation.head.place import cameras_in_world
from neural_strands.preparation.head.request import HeadRequest
from neural_strands.preparation.head.template import draw
from neural_strands.preparation.photographs.folder import write_picture
from neural_strands.preparation.request import PrepareRequest
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.fit_similarity import Similarity

SIDE, VIEWS = 200, 9
UNIT = 0.4
"""Metres in a unit of the cameras."""
UNKNOWN = KnownSize()


@dataclass(frozen=True)
class Scene:
    """What was photographed."""

    folder: Path
    head: Mesh
    hair: dict[str, np.ndarray]
    cameras: list[Camera]

    def request(self, out: Path, size: KnownSize = UNKNOWN, bend: bool = True, **changes) -> PrepareRequest:
        head = HeadRequest(self.folder / "landmarks.json", size=size, bend=bend)
        return replace(PrepareRequest(self.folder / "photos", out, self.folder, head=head), **changes)


def to_their_frame() -> Similarity:
    """From the template's metres to the frame and unit of the cameras."""
    turn = 1.1
    rotation = [[1, 0, 0], [0, math.cos(turn), -math.sin(turn)], [0, math.sin(turn), math.cos(turn)]]
    return Similarity(1 / UNIT, torch.tensor(rotation).double(), torch.tensor([0.3, -1.0, 2.0]).double())


def write_scene(folder: Path) -> Scene:
    """Photograph the head into an existing folder."""
    template = builtin_template()
    mesh = template.head.mesh
    scalp = mesh.faces[template.head.scalp_faces]
    shell = mesh.vertices + 0.012 * vertex_normals(mesh)
    both = Mesh(torch.cat([mesh.vertices, shell]), torch.cat([mesh.faces, scalp + len(mesh.vertices)]))
    random = np.random.default_rng(0)
    (folder / "photos").mkdir()
    marks, hair, cameras = {}, {}, []
    inside = list(INTERIOR)
    for k, turn in enumerate(np.linspace(-1.2, 1.2, VIEWS)):
        eye = torch.tensor([0.75 * math.sin(turn), 0.15, 0.75 * math.cos(turn)], dtype=torch.float32)
        camera = Camera.look_at(eye, torch.tensor([0.0, -0.03, 0.02]), 1.5 * SIDE, (SIDE, SIDE), f"{k}.png")
        body = rasterise_triangles(mesh.vertices, mesh.faces, camera)
        picture = draw(mesh, camera, body, face_paint)
        whole = rasterise_triangles(both.vertices, both.faces, camera)
        covered = (whole.face >= len(mesh.faces)).numpy()
        picture[covered] = np.clip(random.normal((90, 60, 40), 6, (int(covered.sum()), 3)), 0, 255)
        write_picture(folder / "photos" / camera.name, picture)
        hair[camera.name] = covered
        cameras.append(camera)
        if abs(turn) < 0.7:
            pixels, _ = camera.project(template.landmarks)
            marks[camera.name] = {str(i): pixels[i].tolist() for i in inside if bool(pixels[i].isfinite().all())}
    (folder / "landmarks.json").write_text(json.dumps(marks))
    theirs = to_their_frame()
    CaptureWriter(folder).finish(cameras_in_world(cameras, theirs))
    return Scene(folder, mesh, hair, cameras)
