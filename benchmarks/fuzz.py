"""Damaged files for every reader: `python benchmarks/fuzz.py OUT --inputs 100000 --seconds 40`.

Each reader gets files made by the project's own writers and damaged by mutators (`tests/support/mutations.py`). It
passes if it returns a result or raises an InputError of one sentence, within ten seconds of processor time, and if a
refused file costs no more memory than ten times its size plus a fixed slack. Every reader runs in its own process, and
ends after the given number of inputs or of processor seconds, whichever comes first: readers differ a hundredfold in
speed. OUT contains one JSON document per reader, written every few seconds; the same command resumes a stopped run.
Inputs that break a reader are stored in OUT/faults, and `--replay FILE` reads one again. Input number n of a seed is
always the same.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

from neural_strands.foundation.files import write_json

SUPPORT = Path(__file__).resolve().parents[1] / "tests" / "support"
sys.path.append(str(SUPPORT))

from fuzzed_input import STUCK, give  # noqa: E402
from fuzzed_readers import READERS, FuzzedReader, write_corpus  # noqa: E402
from mutations import mutated  # noqa: E402

MOST_MEMORY = 12 * 2**30
"""Memory that a process under test may map in addition to what it has at start, bytes."""
SAVE_SECONDS, FAULTS_KEPT = 5.0, 20


@dataclass
class Tally:
    """Results of a reader's inputs so far. `seconds` are of a processor, and include making the damage."""

    reader: str
    seed: int
    inputs: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    peak_over_size: float = 0.0
    peak_bytes: int = 0
    seconds: float = 0.0
    faults: list[dict[str, Any]] = field(default_factory=list)

    def save(self, out: Path) -> None:
        """Write the tally atomically."""
        write_json(tally_path(out, self.reader), vars(self))


def tally_path(out: Path, reader: str) -> Path:
    return out / f"{''.join(letter if letter.isalnum() else '_' for letter in reader)}.json"


def load_tally(out: Path, reader: str, seed: int) -> Tally:
    path = tally_path(out, reader)
    tally = Tally(reader, seed)
    if path.is_file():
        stored = Tally(**json.loads(path.read_text()))
        if stored.seed == seed:
            stored.outcomes = Counter(stored.outcomes)
            tally = stored
    return tally


def damaged(reader: FuzzedReader, content: bytes, seed: int, number: int) -> bytes:
    """Make input number `number` for a reader."""
    return mutated(Random(f"{reader.name} {seed} {number}"), content)


def work(reader: FuzzedReader, corpus: Path, out: Path, seed: int, inputs: int, seconds: float) -> None:
    """Read inputs up to a number of them and of processor seconds, continuing from the tally."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    mapped = 4096 * int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MOST_MEMORY, mapped + MOST_MEMORY))
    tally, saved = load_tally(out, reader.name, seed), time.monotonic()
    path = corpus / reader.file
    content = path.read_bytes()
    reader.read(path)
    current = out / f"{tally_path(out, reader.name).stem}.current"
    before, began = tally.seconds, processor_seconds()
    while tally.inputs < inputs and tally.seconds < seconds:
        damage = damaged(reader, content, seed, tally.inputs)
        path.write_bytes(damage)
        # If the whole process crashes, this file remains.
        current.write_text(str(tally.inputs))
        outcome = give(reader.read, path)
        tally.outcomes[outcome.kind] += 1
        tally.slowest_s = max(tally.slowest_s, outcome.seconds)
        tally.peak_bytes = max(tally.peak_bytes, outcome.peak)
        tally.peak_over_size = max(tally.peak_over_size, outcome.peak / max(1, len(damage)))
        tally.seconds = before + processor_seconds() - began
        if outcome.is_fault:
            add_fault(tally, out, outcome.kind, outcome.detail.replace(str(corpus), ""), damage, path.suffix)
        tally.inputs += 1
        if time.monotonic() - saved > SAVE_SECONDS:
            tally.save(out)
            saved = time.monotonic()
    tally.save(out)
    current.unlink()


def add_fault(tally: Tally, out: Path, kind: str, detail: str, damage: bytes, suffix: str) -> None:
    """Store the first input of each fault."""
    known = {fault["detail"].rpartition(" at ")[2] if kind == "crash" else fault["kind"] for fault in tally.faults}
    new = (detail.rpartition(" at ")[2] if kind == "crash" else kind) not in known
    if new and len(tally.faults) < FAULTS_KEPT:
        kept = out / "faults" / f"{tally_path(out, tally.reader).stem}_{tally.inputs}{suffix}"
        kept.parent.mkdir(exist_ok=True)
        kept.write_bytes(damage)
        tally.faults.append({"kind": kind, "detail": detail, "input": tally.inputs, "file": kept.name})


def processor_seconds() -> float:
    """Processor seconds of this process and of those that it has started and that have ended."""
    return sum(os.times()[:4])


def drive(reader: FuzzedReader, corpus: Path, out: Path, seed: int, inputs: int, seconds: float) -> Tally:
    """Run a reader in separate processes; one that dies or hangs without reacting to signals is a fault."""
    current = out / f"{tally_path(out, reader.name).stem}.current"
    while (tally := load_tally(out, reader.name, seed)).inputs < inputs and tally.seconds < seconds:
        # What an earlier process left is older than a hang; this one has not begun to read.
        current.unlink(missing_ok=True)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / "corpus"
            shutil.copytree(corpus, copy)
            command = [sys.executable, __file__, str(out), "--worker", reader.name, "--corpus", str(copy)]
            bounds = ["--inputs", str(inputs), "--seconds", str(seconds)]
            process = subprocess.Popen([*command, "--seed", str(seed), *bounds])
            while process.poll() is None:
                time.sleep(0.5)
                try:
                    stuck = time.time() - current.stat().st_mtime > 2 * STUCK
                except FileNotFoundError:
                    stuck = False
                if stuck:
                    process.kill()
            if process.returncode == 0:
                continue
            if not current.is_file():
                raise RuntimeError(f"{reader.name}: the valid file is not read")
            tally = load_tally(out, reader.name, seed)
            number = int(current.read_text())
            content = (corpus / reader.file).read_bytes()
            tally.inputs = number
            detail = f"the process ended with {process.returncode}"
            tally.outcomes["died"] += 1
            add_fault(tally, out, "died", detail, damaged(reader, content, seed, number), Path(reader.file).suffix)
            tally.inputs += 1
            tally.save(out)
    return tally


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--inputs", type=int, default=100_000, help="for each reader")
    parser.add_argument("--slow-inputs", type=int, help="for each slow reader, if other")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="of a processor, for each reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="readers whose name holds this")
    parser.add_argument("--replay", type=Path, help="one file, read by the reader of --only")
    parser.add_argument("--worker")
    parser.add_argument("--corpus", type=Path)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    os.environ["NEURAL_STRANDS_WEIGHTS"] = str(options.out / "none")
    if options.worker:
        reader = next(reader for reader in READERS if reader.name == options.worker)
        work(reader, options.corpus, options.out, options.seed, options.inputs, options.seconds)
        return
    corpus = options.out / "corpus"
    if not corpus.is_dir():
        part = options.out / "corpus.part"
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir()
        write_corpus(part)
        part.rename(corpus)
    for reader in (reader for reader in READERS if options.only in reader.name):
        if options.replay is not None:
            with tempfile.TemporaryDirectory() as folder:
                copy = Path(folder) / "corpus"
                shutil.copytree(corpus, copy)
                shutil.copyfile(options.replay, copy / reader.file)
                reader.read(copy / reader.file)
            continue
        inputs = options.inputs if options.slow_inputs is None or not reader.is_slow else options.slow_inputs
        tally = drive(reader, corpus, options.out, options.seed, inputs, options.seconds)
        print(json.dumps(vars(tally)), flush=True)


if __name__ == "__main__":
    main()
