"""Every reader gets a few damaged files; `benchmarks/fuzz.py` does the same for hours."""

import io
import pickle
import time
import zipfile
from pathlib import Path
from random import Random

import fuzzed_input
import numpy as np
import pytest
import torch
from fuzzed_input import give
from fuzzed_readers import READERS, FuzzedReader, write_corpus
from mutations import mutated

from neural_strands.foundation.errors import InputError

INPUTS, SLOW_INPUTS = 6, 1


@pytest.fixture(scope="module")
def corpus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("corpus")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEURAL_STRANDS_WEIGHTS", str(folder / "none"))
        write_corpus(folder)
    return folder


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damage_is_read_or_refused(reader: FuzzedReader, corpus: Path):
    path = corpus / reader.file
    content = path.read_bytes()
    reader.read(path)
    try:
        for number in range(SLOW_INPUTS if reader.is_slow else INPUTS):
            path.write_bytes(mutated(Random(f"{reader.name} 0 {number}"), content))
            outcome = give(reader.read, path)
            assert not outcome.is_fault, f"input {number}: {outcome}"
    finally:
        path.write_bytes(content)


class Trap:
    """Where this is unpickled, a file appears."""

    def __init__(self, mark: Path):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


def trapped_files(trap: Trap) -> dict[str, bytes]:
    """Files of each kind that can hold pickles."""
    npz, npy, checkpoint = io.BytesIO(), io.BytesIO(), io.BytesIO()
    held = np.array([trap], dtype=object)
    np.savez(npz, allow_pickle=True, points=held)
    np.save(npy, held, allow_pickle=True)
    torch.save({"state": trap}, checkpoint)
    pickles = {f"pickle {protocol}": pickle.dumps(trap, protocol) for protocol in (0, 2, pickle.HIGHEST_PROTOCOL)}
    return {**pickles, "npz": npz.getvalue(), "npy": npy.getvalue(), "checkpoint": checkpoint.getvalue()}


def with_traps(content: bytes, trap: Trap) -> bytes:
    """An archive in which every array has been replaced by one that is pickled."""
    array, written = io.BytesIO(), io.BytesIO()
    np.save(array, np.array([trap], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(io.BytesIO(content)) as archive, zipfile.ZipFile(written, "w") as changed:
        for name in archive.namelist():
            trapped = pickle.dumps(trap) if name.endswith(".pkl") else array.getvalue()
            changed.writestr(name, trapped if name.endswith((".npy", ".pkl")) else archive.read(name))
    return written.getvalue()


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_no_reader_runs_what_a_file_pickles(reader: FuzzedReader, corpus: Path, tmp_path: Path):
    path, trap = corpus / reader.file, Trap(tmp_path / "code was run")
    content = path.read_bytes()
    files = trapped_files(trap)
    if zipfile.is_zipfile(path):
        files["the archive itself"] = with_traps(content, trap)
    try:
        for name, trapped in files.items():
            path.write_bytes(trapped)
            outcome = give(reader.read, path)
            assert not trap.mark.exists(), f"{name}: {outcome}"
            assert not outcome.is_fault, f"{name}: {outcome}"
    finally:
        path.write_bytes(content)


def test_the_trap_works(tmp_path: Path):
    trap = Trap(tmp_path / "code was run")
    files = trapped_files(trap)
    pickle.loads(files["pickle 2"])
    assert trap.mark.exists()
    trap.mark.unlink()
    with np.load(io.BytesIO(files["npz"]), allow_pickle=True) as loaded:
        loaded["points"]
    assert trap.mark.exists()
    trap.mark.unlink()
    torch.load(io.BytesIO(files["checkpoint"]), weights_only=False)
    assert trap.mark.exists()


def crash(path: Path):
    raise KeyError(path.read_bytes())


def hang(path: Path):
    time.sleep(5)


def labour(path: Path):
    end = time.process_time() + 0.3
    while time.process_time() < end:
        pass


def waste(path: Path):
    np.ones(2**26, np.uint8)
    raise InputError("too large.")


def mumble(path: Path):
    raise InputError("two\nlines")


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (crash, "crash"),
        (hang, "hang"),
        (labour, "hang"),
        (waste, "greedy"),
        (mumble, "sentence"),
        (Path.read_bytes, "read"),
    ],
)
def test_faults_are_told_apart(read, kind, tmp_path, monkeypatch):
    if kind == "hang":
        # The other readers may take longer than this where a machine is slow.
        monkeypatch.setattr(fuzzed_input, "SECONDS", 0.25)
        monkeypatch.setattr(fuzzed_input, "STUCK", 2.0)
    path = tmp_path / "a"
    path.write_bytes(b"content")
    assert give(read, path).kind == kind


def test_damage_repeats_and_differs(corpus: Path):
    content = (corpus / "segments.npz").read_bytes()
    damages = [mutated(Random(seed), content) for seed in range(50)]
    assert damages == [mutated(Random(seed), content) for seed in range(50)]
    assert len(set(damages)) > 40


def test_containers_stay_whole_around_the_damage(corpus: Path, tmp_path: Path):
    """Most damaged archives still open, because the damage is inside them."""
    path, opened = tmp_path / "a.npz", 0
    for seed in range(60):
        path.write_bytes(mutated(Random(seed), (corpus / "segments.npz").read_bytes()))
        opened += zipfile.is_zipfile(path)
    assert opened > 30


def parts_fit(content: bytes) -> bool:
    """Whether the lengths of a file's boxes, or of a JPEG's segments up to the compressed picture, lead to the end."""
    has_boxes = content[4:8] == b"ftyp"
    at = 0 if has_boxes else 2
    while at < len(content):
        if not has_boxes and content[at : at + 2] == b"\xff\xda":
            return True
        length = int.from_bytes(content[at : at + 4] if has_boxes else content[at + 2 : at + 4], "big")
        if length < 2:
            return False
        at += length if has_boxes else 2 + length
    return has_boxes and at == len(content)


@pytest.mark.parametrize("name", ["a.jpg", "a.mp4", "a.heic"])
def test_segments_and_boxes_stay_whole_around_the_damage(name: str, corpus: Path):
    content = (corpus / "photographs" / name).read_bytes()
    damages = [mutated(Random(seed), content) for seed in range(60)]
    assert parts_fit(content)
    assert not parts_fit(content[: len(content) // 3])
    assert sum(map(parts_fit, damages)) > 30
    assert len(set(damages)) > 40
