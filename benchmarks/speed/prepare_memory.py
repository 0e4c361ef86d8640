"""Peak memory of each stage of `prepare`: `python benchmarks/speed/prepare_memory.py OUT --photographs 12`.

Makes JPEG photographs of 6000 x 4000 pixels of a head with a cap of hair in a papered room, unless OUT has them, and
runs `neural-strands prepare` on them in a process of its own. Prints one JSON object: for each stage, seconds,
processor seconds and the peak of the memory of that process and those that it starts, GB. What comes after a stage and
has no folder of its own counts as part of it. Two runs with different numbers of photographs show what a further one
costs.
"""

import contextlib
import json
import math
import os
import shlex
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
import tyro

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests" / "support"))

from papered_room import room, wallpaper

from neural_strands.capture.writer import CaptureWriter
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.builtin import builtin_template, face_paint
from neural_strands.preparation.head.template import draw
from neural_strands.preparation.request import STAGES
from neural_strands.raster.triangles import rasterise_triangles

WIDTH, HEIGHT = 6000, 4000
SMALLER = 4
"""Everything but the grain is drawn at this fraction of the size, and enlarged."""
ARC = 1.8
"""Largest angle of the cameras from the front, radians."""
PAPER, BLOTS = 2048, (8, 24, 72, 200, 600)
INTERVAL = 0.02
"""Seconds between two looks at the memory."""
DETECTOR = """#!{python}
import json, pathlib, sys
import cv2
request, here = json.load(sys.stdin), pathlib.Path({folder!r})
faces = json.loads((here / "landmarks.json").read_text())
for image in map(pathlib.Path, request["images"]):
    height, width = cv2.imread(str(image)).shape[:2]
    person = cv2.imread(str(here / "person" / (image.stem + ".png")), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(request["masks"] + "/" + image.stem + ".png", cv2.resize(person, (width, height)))
    scale = width / {width}
    marks = faces.get(image.stem + ".jpg")
    face = marks and [[scale * x for x in marks.get(str(k), [float("nan")] * 2)] for k in range(478)]
    print(json.dumps({{"image": str(image), "faces": [face] if face else []}}), flush=True)
"""
"""A program that answers like MediaPipe's, with the landmarks and outlines that are known."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    out: Annotated[Path, tyro.conf.Positional]
    """Folder for photographs and captures."""
    photographs: int = 12
    """Number of photographs."""
    options: str = ""
    """Further options of `prepare`; {photos} is replaced by the folder of the photographs, of their cameras
    (transforms.json), landmarks (landmarks.json) and hair masks (masks), and of a program for --detector (detector)."""


def photograph(folder: Path, count: int) -> None:
    """Write photographs, their cameras, masks of person and hair, and the landmarks of the frontal ones."""
    template, random = builtin_template(), np.random.default_rng(0)
    papers = [wallpaper(random, PAPER, BLOTS) for _ in range(6)]
    mesh = template.head.mesh
    scalp = mesh.faces[template.head.scalp_faces]
    shell = mesh.vertices + 0.012 * vertex_normals(mesh)
    both = Mesh(torch.cat([mesh.vertices, shell]), torch.cat([mesh.faces, scalp + len(mesh.vertices)]))
    marks, cameras = {}, []
    (folder / "photos").mkdir(parents=True)
    (folder / "masks").mkdir()
    (folder / "person").mkdir()
    for k in track(range(count), "photographing"):
        turn = ARC * (2 * k / (count - 1) - 1)
        eye = torch.tensor([0.8 * math.sin(turn), 0.15 + 0.15 * math.sin(3 * turn), 0.8 * math.cos(turn)])
        camera = Camera.look_at(eye, torch.zeros(3), 1.6 * HEIGHT, (WIDTH, HEIGHT), f"{k:03d}.jpg")
        small = camera.resized(WIDTH // SMALLER, HEIGHT // SMALLER)
        body = rasterise_triangles(mesh.vertices, mesh.faces, small)
        whole = rasterise_triangles(both.vertices, both.faces, small)
        hair, person = (whole.face >= len(mesh.faces)).numpy(), (whole.face >= 0).numpy()
        picture = np.where(person[..., None], draw(mesh, small, body, face_paint), room(small, papers))
        picture[hair] = np.clip(random.normal((90, 60, 40), 12, (int(hair.sum()), 3)), 0, 255)
        picture, mask = (
            cv2.resize(layer.astype(np.uint8), (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
            for layer in (picture, hair * 255.0)
        )
        picture = cv2.add(picture, random.integers(0, 12, picture.shape, dtype=np.uint8))
        cv2.imwrite(str(folder / "photos" / camera.name), picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
        cv2.imwrite(str(folder / "masks" / f"{k:03d}.png"), mask)
        cv2.imwrite(str(folder / "person" / f"{k:03d}.png"), person.astype(np.uint8) * 255)
        cameras.append(camera)
        if float(eye[2]) > 0.5:
            pixels, _ = camera.project(template.landmarks)
            marks[camera.name] = {str(i): pixels[i].tolist() for i in INTERIOR if bool(pixels[i].isfinite().all())}
    (folder / "landmarks.json").write_text(json.dumps(marks))
    program = folder / "detector"
    program.write_text(DETECTOR.format(python=sys.executable, folder=str(folder.resolve()), width=WIDTH))
    program.chmod(0o755)
    CaptureWriter(folder).finish(cameras)


def resources(process: int) -> tuple[float, float]:
    """Resident bytes and processor seconds of a process and its descendants, from /proc (Linux)."""
    memory, used = 0.0, 0.0
    waiting = [process]
    while waiting:
        folder = Path("/proc") / str(waiting.pop())
        # Processes may end at any time.
        with contextlib.suppress(OSError):
            memory += int((folder / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
            times = (folder / "stat").read_text().rpartition(")")[2].split()
            used += (int(times[11]) + int(times[12])) / os.sysconf("SC_CLK_TCK")
            for thread in (folder / "task").iterdir():
                waiting += [int(child) for child in (thread / "children").read_text().split()]
    return memory, used


def measure(command: list[str], stages: Path) -> dict[str, dict[str, float]]:
    """Run a command, and look at its memory and at the stage it is in until it ends."""
    figures: dict[str, dict[str, float]] = {}
    stage, since, spent = "start", time.monotonic(), 0.0
    with subprocess.Popen(command) as process:
        while process.poll() is None:
            memory, used = resources(process.pid)
            # A stage that is at work has a temporary folder, .NAME.DIGITS.
            at_work = [path.name.split(".")[1] for path in stages.glob(".*.*") if path.is_dir()]
            now = time.monotonic()
            if at_work:
                stage = at_work[0]
            row = figures.setdefault(stage, {"seconds": 0.0, "processor_seconds": 0.0, "peak_gb": 0.0})
            row["seconds"] += now - since
            row["processor_seconds"] += max(used - spent, 0.0)
            row["peak_gb"] = max(row["peak_gb"], memory / 1e9)
            since, spent = now, used
            time.sleep(INTERVAL)
    if process.returncode != 0:
        raise SystemExit(process.returncode)
    return {name: {key: round(value, 3) for key, value in row.items()} for name, row in figures.items()}


def main(arguments: Arguments) -> None:
    """Make the photographs, prepare them, and print the figures."""
    folder = arguments.out / f"{arguments.photographs}"
    if not (folder / "transforms.json").is_file():
        photograph(folder, arguments.photographs)
    number = sum(path.is_dir() for path in folder.glob("capture_*"))
    capture = folder / f"capture_{number}"
    words = [word.replace("{photos}", str(folder)) for word in shlex.split(arguments.options)]
    command = [sys.executable, "-m", "neural_strands", "prepare", str(folder / "photos"), str(capture), *words]
    stages = measure(command, capture / STAGES)
    document = {"photographs": arguments.photographs, "options": arguments.options, "stages": stages}
    sys.stdout.write(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
