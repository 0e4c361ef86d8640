"""Two processes that share the views of a step end where one process ends."""

import os
import socket
import subprocess
import sys
from pathlib import Path

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
    # Gradients of the last step, which saw two views: Adam would blow rounding up to whole steps in the weights.
    assert float(one["appearance"].abs().max()) > 0
    for name, gradient in one.items():
        assert (two[name] - gradient).norm() < 1e-3 * gradient.norm(), name
