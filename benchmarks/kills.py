"""Kills work at random times and restarts it: `python benchmarks/kills.py OUT --kills 100`.

A small fit (`stereo`: one that finds its segments itself), preparation or batch (extra `batch`) is first run without
interruption. Then it is repeated in processes that SIGKILL ends at random times, up to five times before one may
finish. Each result must be identical, byte for byte, to the uninterrupted one, and no unfinished files may remain.
Prints one JSON document.
"""

import argparse
import contextlib
import io
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from batch_files import write_ball, write_subjects
from photographed_head import write_scene
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.cli.main import main as command
from neural_strands.foundation.files import LEFTOVER
from neural_strands.lmvs.files import save_segments
from neural_strands.preparation.prepare import prepare
from neural_strands.runs import run_fit

KILLS_A_ROUND = 5
CHECKPOINT_SECONDS = 0.3
"""Interval between checkpoints, seconds; short, because the fit takes only seconds."""


@dataclass(frozen=True)
class Job:
    """Work that leaves files in a folder.

    Attributes:
        work: does it into a folder, from wherever earlier work there has come.
        results: which of the files are results: patterns of names, from the folder.
        progress: pattern of files that are written one after the other. Then the work is killed when a random number
            of them is there, instead of at a random time.
    """

    work: Callable[[Path], None]
    results: Sequence[str]
    progress: str = ""


def fit_job(folder: Path) -> Job:
    """A fit of a few seconds, with given segments."""
    save_segments(folder / "segments.npz", true_segments(write_capture(folder / "ball", views=6)))
    settings = folder / "tiny.json"
    settings.write_text(json.dumps(asdict(tiny_config(steps=16))))
    run_fit.CHECKPOINT_SECONDS = CHECKPOINT_SECONDS

    def work(out: Path) -> None:
        words = ["fit", str(folder / "ball"), str(out), "--segments", str(folder / "segments.npz")]
        if command([*words, "--config", str(settings), "--resume"]) != 0:
            raise RuntimeError("the fit did not end well")

    return Job(work, ("segments.npz", "model/model.safetensors", "groom.npz", "groom.usd"))


def stereo_job(folder: Path) -> Job:
    """A fit of a few seconds that is killed while it finds its segments itself."""
    write_capture(folder / "ball", views=8, shaded=True)
    settings = folder / "tiny.json"
    settings.write_text(json.dumps(asdict(tiny_config(steps=4, hold_out_every=0))))
    run_fit.CHECKPOINT_SECONDS = CHECKPOINT_SECONDS

    def work(out: Path) -> None:
        if command(["fit", str(folder / "ball"), str(out), "--config", str(settings), "--resume"]) != 0:
            raise RuntimeError("the fit did not end well")

    results = ("segments.npz", "lmvs/*.npz", "model/model.safetensors", "groom.npz", "groom.usd")
    return Job(work, results, "lmvs/[fl]*.npz")


def prepare_job(folder: Path) -> Job:
    """A preparation of a few seconds, with given cameras and landmarks."""
    (folder / "scene").mkdir()
    scene = write_scene(folder / "scene")

    def work(out: Path) -> None:
        prepare(scene.request(out), lambda _: None)

    return Job(work, ("**/*.json", "**/*.png", "**/*.obj", "**/*.npz"))


def batch_job(folder: Path) -> Job:
    """A batch of two subjects on this machine; its workers outlive it for a moment when it is killed."""
    ball = write_ball(folder)
    subjects = write_subjects(folder / "subjects.toml", {"bob": ball, "twin": ball}, steps=30)

    def work(out: Path) -> None:
        if command(["batch", str(subjects), str(out), "--resume"]) != 0:
            raise RuntimeError("the batch did not end well")

    return Job(work, ("*/run/segments.npz", "*/run/model/model.safetensors", "*/run/groom.npz", "*/run/groom.usd"))


JOBS = {"fit": fit_job, "stereo": stereo_job, "prepare": prepare_job, "batch": batch_job}


def moments(job: Job, out: Path, seconds: float, random: Random, count: int) -> list[Callable[[float], bool]]:
    """When to kill: each function takes the seconds since the start, and says whether the moment has come."""
    if not job.progress:
        times = [random.uniform(0, seconds) for _ in range(count)]
        return [lambda now, time=time: now >= time for time in times]
    files = len(contents(out.parents[1] / "whole" / "result", [job.progress]))
    numbers = sorted(random.sample(range(1, files + 1), count))
    return [lambda _, number=number: len(list(out.glob(job.progress))) >= number for number in numbers]


def survive(work: Callable[[], None], kills: Sequence[Callable[[float], bool]]) -> int:
    """Run the work in processes that are killed when each of these says so; the last one may finish."""
    killed = 0
    for kill in (*kills, lambda _: False):
        child = os.fork()
        if child == 0:
            os._exit(in_child(work))
        began = time.monotonic()
        while (ended := os.waitpid(child, os.WNOHANG))[0] == 0 and not kill(time.monotonic() - began):
            time.sleep(0.002)
        if ended[0] != 0:
            if ended[1] != 0:
                raise RuntimeError(f"after {killed} kills the work ended with status {ended[1]}")
            break
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        killed += 1
    return killed


def in_child(work: Callable[[], None]) -> int:
    """Run the work and return its status; its output is shown only if it fails."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        try:
            work()
            return 0
        except Exception as error:
            failed = f"{type(error).__name__}: {error}"
    sys.stderr.write(f"{said.getvalue()}{failed}\n")
    return 1


def contents(folder: Path, patterns: Sequence[str]) -> dict[str, bytes]:
    """The contents of all result files, by name."""
    files = {path for pattern in patterns for path in folder.glob(pattern) if path.is_file()}
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(files)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, help="a new folder")
    parser.add_argument("--job", choices=JOBS, default="fit")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True)
    os.environ["NEURAL_STRANDS_WEIGHTS"] = str(options.out / "none")
    job = JOBS[options.job](options.out)
    began = time.monotonic()
    survive(lambda: job.work(options.out / "whole" / "result"), ())
    seconds = time.monotonic() - began
    expected = contents(options.out / "whole" / "result", job.results)
    random, killed, rounds = Random(options.seed), 0, 0
    different: set[str] = set()
    leftovers: set[str] = set()
    while killed < options.kills:
        rounds += 1
        out = options.out / f"round_{rounds}" / "result"
        planned = min(KILLS_A_ROUND, options.kills - killed)
        killed += survive(lambda out=out: job.work(out), moments(job, out, seconds, random, planned))
        found = contents(out, job.results)
        different |= {name for name in {**expected, **found} if expected.get(name) != found.get(name)}
        leftovers |= {path.name for path in out.rglob(".*") if LEFTOVER.fullmatch(path.name)}
    figures = {"job": options.job, "kills": killed, "rounds": rounds, "whole_s": round(seconds, 2)}
    print(json.dumps({**figures, "files": len(expected), "different": sorted(different), "left": sorted(leftovers)}))


if __name__ == "__main__":
    main()
