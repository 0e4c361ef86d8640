"""All work that should be repeatable, on the smallest data: `python whole_line.py OUT TIMES`.

It works with three threads, in OUT/0, OUT/1 and so on, on photographs that it writes to OUT/given. It prints the digest
of every result as JSON, one line for each.
"""

import hashlib
import io
import json
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest.mock import patch

import cv2
import torch
from photographed_head import Scene, write_scene
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.cli.main import main
from neural_strands.lmvs.files import SegmentsSource, save_segments
from neural_strands.preparation.prepare import prepare
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior_training import curve_stream
from neural_strands.prior_training.config import TrainPriorConfig
from neural_strands.prior_training.train_prior import train_prior

THREADS, VIEWS = 3, 6
EDITS = {
    "cut": ["haircut", "--length", "0.05"],
    "denser": ["density", "--strands", "300"],
    "curled": ["restyle", "--curl", "1", "--volume", "0.5"],
    "mixed": ["blend", "--other", "OTHER"],
    "moved": ["transfer", "--other", "OTHER"],
    "drawn": ["sample"],
    "blown": ["wind", "--seconds", "0.2"],
    "simulated": ["wind", "--simulate", "--seconds", "0.2"],
}
RESULTS = ("*.safetensors", "*.npz", "*.usd", "*.png", "*.webp", "*.obj", "transforms.json", "figures.json")


def use_threads(count: int) -> None:
    """Let torch and OpenCV use so many threads."""
    torch.set_num_threads(count)
    cv2.setNumThreads(count)


def command(*words: object) -> str:
    """Run a command, and return what it prints."""
    printed, said = io.StringIO(), io.StringIO()
    with redirect_stdout(printed), redirect_stderr(said):
        status = main([str(word) for word in words])
    if status != 0:
        raise RuntimeError(f"{words[0]} ended with status {status}: {said.getvalue()}")
    return printed.getvalue()


@dataclass(frozen=True)
class Given:
    """What the work begins with: photographs to prepare; a capture, `ball`, and its line segments."""

    folder: Path
    scene: Scene


def write_given(folder: Path) -> Given:
    """Photograph both into a new folder."""
    (folder / "scene").mkdir(parents=True)
    strands = write_capture(folder / "ball", views=VIEWS)
    seen = tuple(f"{view:03d}.png" for view in range(VIEWS) if view % 5 != 4)
    save_segments(folder / "segments.npz", true_segments(strands), SegmentsSource(seen))
    return Given(folder, write_scene(folder / "scene"))


def work(out: Path, given: Given) -> None:
    """Prepare photographs; stereo, two fits, scores, pictures, edits; train a prior."""
    out.mkdir(parents=True)
    ball, segments = given.folder / "ball", given.folder / "segments.npz"
    prepare(given.scene.request(out / "prepared"), lambda _: None)
    command("lmvs", ball, out / "stereo")
    for name, start in (("run", "flow"), ("other", "mean")):
        settings = out / f"{name}.json"
        settings.write_text(json.dumps(asdict(tiny_config(steps=8, initialise=start))))
        command("fit", ball, out / name, "--segments", segments, "--config", settings)
    (out / "evaluated").mkdir()
    figures = json.loads(command("evaluate", out / "run", "--json"))
    del figures["milliseconds"]
    (out / "evaluated" / "figures.json").write_text(json.dumps(figures))
    command("render", out / "run", "--turntable", 2, "--size", 96, 96, "--out", out / "turntable")
    for name, words in EDITS.items():
        command("edit", out / "run", out / name, *(out / "other" if word == "OTHER" else word for word in words))
    for name in ("blown", "simulated"):
        command("export", out / name, out / f"{name}.usd")
    tiny = TrainPriorConfig(
        steps=4, sine_steps=2, start_curves=200, batch=16, generator=GeneratorConfig(layers=2, hidden=16)
    )
    with patch.object(curve_stream, "CHUNK", 64):
        train_prior(out / "prior.safetensors", tiny, seed=1)


def digests(out: Path) -> dict[str, str]:
    """The digest of every result in a folder, by name."""
    files = sorted({path for pattern in RESULTS for path in out.rglob(pattern)})
    return {path.relative_to(out).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


if __name__ == "__main__":
    root, times = Path(sys.argv[1]), int(sys.argv[2])
    os.environ["NEURAL_STRANDS_WEIGHTS"] = str(root / "none")
    use_threads(THREADS)
    given = write_given(root / "given")
    for number in range(times):
        work(root / str(number), given)
        sys.stdout.write(json.dumps(digests(root / str(number))) + "\n")
    slow = {"torch._dynamo", "sympy"} & set(sys.modules)
    if slow:
        raise RuntimeError(f"{sorted(slow)} was imported, which takes seconds and is of no use here")
