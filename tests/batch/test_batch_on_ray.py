"""A batch on a cluster of two nodes, one of which is killed halfway; a failing subject; resuming."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from batch_files import write_ball, write_subjects
from html_page import ReportPage

SUPPORT = Path(__file__).resolve().parents[1] / "support"
RESULTS = ("run/groom.npz", "run/groom.usd", "run/model/model.safetensors", "run/segments.npz")


@pytest.fixture
def nodes():
    """Two nodes, which end with the test."""
    pytest.importorskip("ray", reason="the extra batch is not installed")
    with subprocess.Popen(
        [sys.executable, str(SUPPORT / "ray_nodes.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        yield process
        process.stdin.close()
        assert process.wait(60) == 0


def started(words, folder):
    environment = {**os.environ, "NEURAL_STRANDS_WEIGHTS": str(folder / "none")}
    command = [sys.executable, "-m", "neural_strands", "batch", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)


def bits(folder):
    return {name: (folder / name).read_bytes() for name in RESULTS}


@pytest.mark.slow(seconds=200)
@pytest.mark.timeout(3000)
@pytest.mark.skipif(os.name == "nt", reason="a killed node is one of Linux or macOS")
def test_a_killed_node_costs_nothing_and_a_broken_subject_stops_no_other(nodes, tmp_path):
    ball = write_ball(tmp_path)
    tables = {"bob": ball, "twin": ball, "eve": {**ball, "capture": str(tmp_path / "later")}}
    subjects, out = write_subjects(tmp_path / "subjects.toml", tables, steps=60, initialise="mean"), tmp_path / "out"
    address = nodes.stdout.readline().strip()
    batch = started([subjects, out, "--address", address, "--json"], tmp_path)
    checkpoints = [out / name / "run" / "checkpoint.pt" for name in ("bob", "twin")]
    while not all(path.is_file() for path in checkpoints) and batch.poll() is None:
        time.sleep(0.1)
    time.sleep(1.0)
    nodes.stdin.write("kill\n")
    nodes.stdin.flush()
    told, said = batch.communicate(timeout=1400)
    assert batch.returncode == 2, said
    assert said.splitlines()[-1].startswith(
        "neural-strands: expected all 3 subjects to be done, found 1 that failed: eve;"
    )
    rows = json.loads(told)["rows"]
    assert rows["eve"]["failure"] == f"fit: {tmp_path / 'later'}: expected a capture folder, found nothing."
    assert sum(rows[name]["workers_lost"] for name in ("bob", "twin")) == 1, said
    assert bits(out / "bob") == bits(out / "twin")
    page = ReportPage((out / "index.html").read_text())
    assert page.tables["Failed"][1] == ["eve", rows["eve"]["failure"]]
    assert [name for name, _ in page.pictures] == ["bob", "twin"]
    written = (out / "bob" / "run" / "groom.npz").stat().st_mtime_ns
    shutil.copytree(tmp_path / "ball", tmp_path / "later")
    again = started([subjects, out, "--address", address, "--resume"], tmp_path)
    told, said = again.communicate(timeout=1400)
    assert again.returncode == 0, said
    assert told.startswith("3 of 3 subjects done")
    assert (out / "bob" / "run" / "groom.npz").stat().st_mtime_ns == written
    assert bits(out / "eve") == bits(out / "bob")
