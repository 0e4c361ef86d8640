"""Time until the page of a run answers, and pictures per second while the camera moves.

    python benchmarks/speed/viewer.py RUN

Starts `neural-strands view RUN` and counts the seconds until its page answers. Then the camera turns once around the
hair as a user would move it, with pictures as small as the page makes them to keep pace, JPEG included. Prints one JSON
object.
"""

import json
import math
import re
import subprocess
import sys
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import torch
import tyro

from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.runs.newest_model import newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.cameras import PageCamera
from neural_strands.viewer.frames import rendered
from neural_strands.viewer.layers import wxyz_of
from neural_strands.viewer.open_scene import open_run
from neural_strands.viewer.pace import Pace
from neural_strands.viewer.page import JPEG_QUALITY
from neural_strands.viewer.render_loop import SECONDS_A_FRAME

ASPECT = 1.6
"""Size of a common window."""
FIELD_OF_VIEW = math.radians(25.0)


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of a run."""
    frames: int = 60
    """Number of pictures per turn."""


def page_ready(run: Path) -> float:
    """Seconds from the command to the answer of its page."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "neural_strands", "view", str(run), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address is not None
        with urllib.request.urlopen(address[0]) as answer:
            answer.read()
        seconds = time.perf_counter() - began
        process.terminate()
    return seconds


def moving(run: Path, frames: int) -> dict[str, float]:
    """Pictures per second of wall and of processor time, and the median of their longer side, without the first ten."""
    scene = open_run(run, newest_state(RunFolder(run)), torch.device("cpu"))
    assert scene.renderer is not None
    pace, took, sizes, processor = Pace(SECONDS_A_FRAME), [], [], []
    for camera in turntable_cameras(scene.renderer.strands.points, frames + 10, (512, 512)):
        right, up, back = camera.position.tolist()
        page = PageCamera(wxyz_of(camera), (right, up, back), FIELD_OF_VIEW, ASPECT)
        began, spent = time.perf_counter(), time.process_time()
        picture = rendered(scene.renderer, page.sized(pace.size)).picture
        cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        sizes.append(pace.size)
        took.append(time.perf_counter() - began)
        processor.append(time.process_time() - spent)
        pace.took(took[-1])
    return {
        "frames_per_second": round(frames / sum(took[10:]), 1),
        "cpu_seconds_per_frame": round(sum(processor[10:]) / frames, 3),
        "median_longer_side": sorted(sizes[10:])[frames // 2],
    }


def main(arguments: Arguments) -> None:
    """Measure and print."""
    keep_freed_memory()
    figures = {"page_ready_s": round(page_ready(arguments.run), 2), **moving(arguments.run, arguments.frames)}
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
