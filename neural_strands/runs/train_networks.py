"""Trains the networks from which fits start: fits of several captures in turn, each from the networks of the last."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.config import FitConfig
from neural_strands.foundation.progress import Feedback
from neural_strands.model.files import WEIGHTS_NAME
from neural_strands.model.networks import save_networks
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.runs.run_folder import RunFolder


def train_networks(
    out: Path, captures: Sequence[Path], config: FitConfig, device: torch.device, feedback: Feedback
) -> None:
    """Train an image generator and a point shader, from random weights, and write them.

    The fits are kept beside the file, in a folder of its name with `_fits`, so that a stopped training continues.

    Args:
        out: file for the weights (safetensors).
        captures: folders of the captures, in the order of training.
        config: settings of each fit.
        device: where to compute.
        feedback: receives each stage and the progress within it.

    Raises:
        InputError: a capture cannot be fitted, or a file cannot be written.
    """
    for capture in captures:
        # A mistake in the last capture must not show after hours.
        find_head(Capture.load(capture))
    notes = {"captures": ", ".join(capture.name for capture in captures), "steps": str(config.steps)}
    fits, before = out.with_name(f"{out.stem}_fits"), None
    for number, capture in enumerate(captures, start=1):
        feedback.say(f"capture {number} of {len(captures)}: {capture}")
        run = fits / f"{number}_{capture.name}"
        request = FitRequest(capture, run, resume=True, networks=before)
        state = run_fit(request, replace(config, networks="random"), device, feedback)
        before = RunFolder(run).model / WEIGHTS_NAME
        if number == len(captures):
            save_networks(state.model, out, notes)
