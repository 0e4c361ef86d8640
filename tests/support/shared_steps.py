"""A fit of two steps by one process, or by those of a group: `python shared_steps.py CAPTURE STRANDS OUT`."""

import sys
from pathlib import Path

import torch
from tiny_capture import tiny_config, true_segments

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.distributed import Workers
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.prior.vae import load_prior


def take_steps(folder: Path, strands: Path, out: Path) -> None:
    """Fit a capture with true strands; the leader writes the drawn strands and the gradients of the last step."""
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


if __name__ == "__main__":
    torch.set_num_threads(1)
    take_steps(*map(Path, sys.argv[1:]))
