"""Runs everything that needs a GPU, in parts of less than nine minutes: `benchmarks/gpu.sh OUT [CAPTURE]`.

The parts, in order: tests that compare the device with the CPU; the speed of frames, of the prior, of a fit's step, and
of line drawing compared with OpenGL; a drawn capture, unless CAPTURE names one; stereo; the `paper` preset and its
scores, of which those of a drawn capture's pictures mean little; splats of the same photographs by gsplat and
OpenSplat, if `--gsplat` names gsplat's trainer and `--opensplat` the other program (see benchmarks/rivals). A call ends
after `--seconds` with status 75, and the same command resumes, the fit from its checkpoint. OUT contains a JSON file
and a log per part, and `results.md` with tables in the form of docs/results.md. Status 1 means that a part has failed;
remove its `.failed.json` to retry it. Status 2 means that the machine lacks something that one sentence names.
`--device cpu --quick` runs tiny versions of all parts within minutes on any machine.
"""

import argparse
import importlib.util
import json
import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gpu_tables import last_json, results, said

ROOT = Path(__file__).resolve().parents[1]
GO_ON = 75
"""Exit status when the time is up: EX_TEMPFAIL."""
UNREADY = 2
"""Exit status if this machine lacks something."""
PACKAGES = (
    "torch",
    "warp",
    "tyro",
    "trimesh",
    "pxr",
    "flip_evaluator",
    "pytest",
    "pytest_timeout",
    "beartype",
    "hypothesis",
)
"""Packages without which parts fail."""
NO_TESTS = 5
"""pytest's status if no test in a folder uses the device."""
RIVAL_ITERATIONS = 7000
"""Of rivals, so that they end within a call; both have defaults for 30,000, whose intervals they shorten."""
TESTS = ("raster", "geometry", "model", "lmvs", "fitting", "prior")
TINY_CAPTURE = """
import sys
from pathlib import Path
sys.path.append(sys.argv[1])
from tiny_capture import true_segments, write_capture
from neural_strands.lmvs.files import save_segments
out = Path(sys.argv[2])
save_segments(out / "segments.npz", true_segments(write_capture(out / "capture", views=10)))
"""


@dataclass(frozen=True)
class Part:
    """A command, which is done once it has succeeded.

    Attributes:
        name: of its files.
        command: what follows the interpreter.
        figures: makes figures of its standard output.
        accepts: statuses that count as done.
        goes_on: whether it keeps what it has done when it is stopped; any other part must end within one call.
    """

    name: str
    command: Sequence[str]
    figures: Callable[[str], dict[str, Any]] = last_json
    accepts: tuple[int, ...] = (0,)
    goes_on: bool = False


def parts(options: argparse.Namespace) -> list[Part]:
    """All parts, in order."""
    device, quick, out = options.device, options.quick, options.out
    capture, run = options.capture or out / "capture", out / "paper"

    def speed(name: str, *words: str) -> list[str]:
        return [f"benchmarks/speed/{name}.py", "--device", device, *words]

    chosen = ["-m", "gpu"] if device == "cuda" else ["-k", device]
    folders = ["tests/raster/test_splat.py"] if quick else [f"tests/{name}" for name in TESTS]
    found = [
        Part(
            f"parity_{Path(path).stem}",
            ["-m", "pytest", "-q", "-p", "no:cacheprovider", path, "-o", "filterwarnings=default", *chosen],
            said,
            (0, NO_TESTS),
        )
        for path in folders
    ]
    for side in (64,) if quick else (512, 1024):
        strands, runs = ("300", "1") if quick else ("30000", "10")
        words = ["--strands", strands, "--size", str(side), "--runs", runs, "--no-twins"]
        found.append(Part(f"frame_{side}", speed("render", *words)))
    found.append(Part("prior", speed("prior", "--json", *(["--strands", "300", "--repeats", "2"] if quick else []))))
    step = ["--preset", "demo", "--resolution", "64"] if quick else ["--preset", "paper", "--resolution", "1024"]
    found.append(Part("step", speed("fit_step", *step, "--no-twins", "--no-grow"), said))
    found.append(Part("lines", speed("lines", *(["--repeats", "5"] if quick else [])), said))
    if options.capture is None:
        made = ["-c", TINY_CAPTURE, str(ROOT / "tests" / "support"), str(out)]
        found.append(Part("capture", made if quick else speed("drawn_capture", str(capture)), said))
    found.append(Part("lmvs", speed("lmvs", str(capture), str(out / "lmvs"), "--keep"), said, goes_on=True))
    fit = ["-m", "neural_strands", "fit", str(capture), str(run), "--resume", "--json", "--device", device]
    settings = ["--preset", "demo", "--steps", "4", "--strands", "300"] if quick else ["--preset", "paper"]
    if quick and options.capture is None:
        settings += ["--segments", str(out / "segments.npz")]
    found.append(Part("paper_fit", [*fit, *settings], goes_on=True))
    found.append(Part("paper_scores", ["-m", "neural_strands", "evaluate", str(run), "--json", "--device", device]))
    return [*found, *_rivals(options, capture)]


def _rivals(options: argparse.Namespace, capture: Path) -> list[Part]:
    """Those that are not there say so."""
    shared = ["--iterations", str(20 if options.quick else RIVAL_ITERATIONS)]
    programs = {
        "gsplat": ("gsplat_rival", "--trainer", options.gsplat, []),
        "opensplat": ("opensplat", "--program", options.opensplat, ["--device", options.device]),
    }
    return [
        Part(
            f"rival_{name}",
            [
                f"benchmarks/rivals/{script}.py",
                str(capture),
                str(options.out / f"rival_{name}_files"),
                *shared,
                *words,
                *([] if program is None else [option, str(program.absolute())]),
            ],
            goes_on=True,
        )
        for name, (script, option, program, words) in programs.items()
    ]


def run(part: Part, out: Path, seconds: float, whole: bool) -> bool:
    """Run a part that is not yet done.

    Args:
        part: which.
        out: folder of the records.
        seconds: after which it is stopped.
        whole: whether no call has more time than that.

    Returns:
        Whether it is over: done, or failed.
    """
    target, failed, spent = (out / f"{part.name}{end}" for end in (".json", ".failed.json", ".seconds"))
    if target.is_file() or failed.is_file():
        return True
    before, began = float(spent.read_text()) if spent.is_file() else 0.0, time.monotonic()
    with (out / f"{part.name}.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, *part.command],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=log,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        stopped = False
        try:
            output = process.communicate(timeout=seconds)[0]
        except subprocess.TimeoutExpired:
            # Interrupt like Ctrl-C, so that a fit saves its state.
            stopped = True
            process.send_signal(signal.SIGINT)
            output = process.communicate()[0]
        log.write(output)
    total = before + time.monotonic() - began
    if stopped and (part.goes_on or not whole):
        spent.write_text(str(total if part.goes_on else before))
        return False
    text = output.decode(errors="replace")
    record = {"part": part.name, "status": process.returncode, "seconds": round(total, 1), **part.figures(text)}
    well = not stopped and process.returncode in part.accepts
    (target if well else failed).write_text(json.dumps(record, indent=1))
    if not well:
        sys.stderr.write(f"{part.name}: ended with {process.returncode}; see {out / part.name}.log\n")
    return True


def unready(options: argparse.Namespace) -> str | None:
    """A sentence about what this machine lacks, so that no part is begun in vain; None if everything is there."""
    missing = [name for name in PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        return (
            f"{sys.executable}: expected a Python with the packages of this project, found none of "
            f"{', '.join(missing)}; run `pip install -e '.[synthesis,photos,view,dev]'` with it, or `make fast`."
        )
    import torch

    if options.device == "cuda" and not torch.cuda.is_available():
        return (
            f"expected a GPU that torch {torch.__version__} (CUDA {torch.version.cuda}) can use, found none; see "
            "nvidia-smi, install a build of torch for CUDA, or pass --device cpu --quick."
        )
    return None


def machine(device: str) -> dict[str, str]:
    """Describe the machine."""
    import torch
    import warp as wp

    name = torch.cuda.get_device_name() if device == "cuda" else platform.processor() or platform.machine()
    return {"device": name, "torch": torch.__version__, "warp": wp.__version__, "python": platform.python_version()}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("capture", type=Path, nargs="?", help="with true strands, for all scores; made if left out")
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--seconds", type=float, default=520.0, help="after which a call ends")
    parser.add_argument("--quick", action="store_true", help="tiny sizes, to see that everything runs")
    parser.add_argument("--only", default="", help="parts whose names hold this")
    parser.add_argument("--gsplat", type=Path, help="gsplat's examples/simple_trainer.py")
    parser.add_argument("--opensplat", type=Path, help="OpenSplat's program")
    options = parser.parse_args()
    options.out = options.out.absolute()
    options.capture = None if options.capture is None else options.capture.absolute()
    if (lack := unready(options)) is not None:
        sys.stderr.write(f"gpu.sh: {lack}\n")
        return UNREADY
    options.out.mkdir(parents=True, exist_ok=True)
    todo = [part for part in parts(options) if options.only in part.name]
    began, over = time.monotonic(), True
    for part in todo:
        left = options.seconds - (time.monotonic() - began)
        over = left > 0 and run(part, options.out, left, left > 0.9 * options.seconds)
        if not over:
            print(f"Time is up in {part.name}; run the same command again.")
            break
    tables = results(options.out, machine(options.device), options.quick)
    (options.out / "results.md").write_text(tables, encoding="utf-8")
    if not over:
        return GO_ON
    print(tables)
    return int(any((options.out / f"{part.name}.failed.json").is_file() for part in todo))


if __name__ == "__main__":
    sys.exit(main())
