"""Two processes that share the views of a step end where one process ends."""

import json
import os
import socket
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch
from batch_files import write_ball
from shared_steps import take_steps
from tiny_capture import tiny_config, write_capture

from neural_strands.cli.main import main

PROGRAM = Path(__file__).resolve().parents[1] / "support" / "shared_steps.py"


@pytest.mark.usefixtures("shapes_unchecked")
@pytest.mark.slow(seconds=40)
def test_two_processes_agree_with_one(tmp_path):
    ball = tmp_path / "ball"
    strands = write_capture(ball)
    torch.save(strands, tmp_path / "strands.pt")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    group = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    both = [
        subprocess.Popen(
            [sys.executable, str(PROGRAM), str(ball), str(tmp_path / "strands.pt"), str(tmp_path / "two.pt")],
            env={**os.environ, **group, "RANK": str(rank)},
            stderr=subprocess.PIPE,
        )
        for rank in range(2)
    ]
    take_steps(ball, tmp_path / "strands.pt", tmp_path / "one.pt")
    for process in both:
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors.decode()[-2000:]
    one, two = torch.load(tmp_path / "one.pt"), torch.load(tmp_path / "two.pt")
    torch.testing.assert_close(two["drawn"], one["drawn"], atol=2e-4, rtol=0)
    # Gradients of the last step, which saw two views: in the weights, Adam would amplify rounding to whole steps.
    assert float(one["appearance"].abs().max()) > 0
    for name, gradient in one.items():
        assert (two[name] - gradient).norm() < 1e-3 * gradient.norm(), name


@pytest.mark.usefixtures("shapes_unchecked")
@pytest.mark.slow
def test_torchrun_fits_from_the_command_line_as_one_process_does(tmp_path, monkeypatch, capsys):
    """Views of a step are divided; the result is that of one process, to what sums in another order change."""
    ball = write_ball(tmp_path)
    (tmp_path / "tiny.json").write_text(json.dumps(asdict(tiny_config(steps=3, views_per_step=2, initialise="mean"))))
    words = ["fit", str(ball["capture"])]
    options = ["--segments", str(ball["segments"]), "--config", str(tmp_path / "tiny.json"), "--device", "cpu"]
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert main([*words, str(tmp_path / "one"), *options]) == 0
    alone = capsys.readouterr()
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    launched = [*torchrun, "-m", "neural_strands", *words, str(tmp_path / "two"), *options]
    done = subprocess.run(launched, capture_output=True, text=True, check=False, timeout=400)
    assert done.returncode == 0, done.stderr[-2000:]
    assert alone.err.count("segment points") == done.stderr.count("segment points") == 1
    assert done.stdout == alone.out.replace(f"{tmp_path / 'one'}", f"{tmp_path / 'two'}")
    one, two = (np.load(tmp_path / name / "groom.npz")["vertices"] for name in ("one", "two"))
    np.testing.assert_allclose(two, one, atol=2e-4, rtol=0)
    done = subprocess.run([*launched, "--resume"], capture_output=True, text=True, check=False, timeout=400)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "resuming at step 3 of 3" in done.stderr
