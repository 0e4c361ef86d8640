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

SCRIPT = """
import sys
from dataclasses import replace
from pathlib import Path
import torch
from neural_strands.capture.capture import Capture
from neural_strands.prior.vae import load_prior
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.first_model import begin
from neural_strands.capture.head import find_head
from neural_strands.fitting.distributed import Workers
from tiny_capture import tiny_config, true_segments

torch.set_num_threads(1)
folder, strands, out = map(Path, sys.argv[1:])
workers = Workers.join(torch.device("cpu"))
assert workers.agree(7 + workers.rank) == 7
config = tiny_config(steps=2, views_per_step=2)
capture = Capture.load(folder)
segments = true_segments(torch.load(strands))
data = gather_fit_data(capture, find_head(capture, None), segments, config, torch.device("cpu"))
state = begin(data, load_prior(), config)
fit(state, data, config, workers=workers)
if workers.leads:
    learned = {"appearance": state.model.textures.appearance, "shape": state.model.textures.shape}
    learned |= dict(state.model.unet.named_parameters())
    torch.save({"drawn": state.drawn, **{name: value.grad for name, value in learned.items()}}, out)
workers.close()
"""


def start(script, arguments, environment):
    support = Path(__file__).resolve().parents[1] / "support"
    paths = os.pathsep.join([str(support), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, "-c", script, *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": paths, **environment},
        stderr=subprocess.PIPE,
    )


@pytest.mark.slow(seconds=40)
def test_two_processes_agree_with_one(tmp_path):
    from tiny_capture import write_capture

    strands = write_capture(tmp_path / "ball")
    torch.save(strands, tmp_path / "strands.pt")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    arguments = [tmp_path / "ball", tmp_path / "strands.pt"]
    alone = start(SCRIPT, [*arguments, tmp_path / "one.pt"], {})
    group = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    both = [start(SCRIPT, [*arguments, tmp_path / "two.pt"], {**group, "RANK": str(rank)}) for rank in range(2)]
    for process in (alone, *both):
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors.decode()[-2000:]
    one, two = torch.load(tmp_path / "one.pt"), torch.load(tmp_path / "two.pt")
    torch.testing.assert_close(two["drawn"], one["drawn"], atol=2e-4, rtol=0)
    # Gradients of the last step, which saw two views: in the weights, Adam would amplify rounding to whole steps.
    assert float(one["appearance"].abs().max()) > 0
    for name, gradient in one.items():
        assert (two[name] - gradient).norm() < 1e-3 * gradient.norm(), name


@pytest.mark.slow
def test_torchrun_fits_from_the_command_line_as_one_process_does(tmp_path):
    """Views of a step are divided; the result is that of one process, to what sums in another order change."""
    from batch_files import write_ball
    from tiny_capture import tiny_config

    ball = write_ball(tmp_path)
    (tmp_path / "tiny.json").write_text(json.dumps(asdict(tiny_config(steps=3, views_per_step=2))))
    words = ["-m", "neural_strands", "fit", str(ball["capture"])]
    options = ["--segments", str(ball["segments"]), "--config", str(tmp_path / "tiny.json"), "--device", "cpu"]
    group = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    environment = {**os.environ, "NEURAL_STRANDS_WEIGHTS": str(tmp_path / "none"), "OMP_NUM_THREADS": "1"}
    told = {}
    for name, launcher in (("one", []), ("two", group)):
        command = [sys.executable, *launcher, *words, str(tmp_path / name), *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=400)
        assert done.returncode == 0, done.stderr[-2000:]
        told[name] = done.stdout
        assert done.stderr.count("expect about") == 1
    assert told["two"] == told["one"].replace(f"{tmp_path / 'one'}", f"{tmp_path / 'two'}")
    one, two = (np.load(tmp_path / name / "groom.npz")["vertices"] for name in ("one", "two"))
    np.testing.assert_allclose(two, one, atol=2e-4, rtol=0)
    again = [sys.executable, *group, *words, str(tmp_path / "two"), *options, "--resume"]
    done = subprocess.run(again, capture_output=True, text=True, check=False, env=environment, timeout=400)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "resuming at step 3 of 3" in done.stderr
