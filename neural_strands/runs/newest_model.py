"""Finds and reads the newest state of a run, finished or still being fitted."""

from dataclasses import dataclass
from pathlib import Path

import torch

from neural_strands.fitting.checkpoint import load_checkpoint_model
from neural_strands.fitting.first_model import fit_prior
from neural_strands.foundation.errors import InputError
from neural_strands.model.files import WEIGHTS_NAME, load_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.runs.run_folder import RunFolder, read_description, weights_digest


@dataclass(frozen=True)
class StateFile:
    """A file with a state of a run.

    Attributes:
        path: the checkpoint, or the weights of the model's folder.
        written: time of writing, nanoseconds; different for each state.
    """

    path: Path
    written: int


def newest_state(folder: RunFolder) -> StateFile | None:
    """The newest of a run's checkpoint and its model; None before the fit has written either."""
    found = []
    for path in (folder.checkpoint, folder.model / WEIGHTS_NAME):
        try:
            found.append(StateFile(path, path.stat().st_mtime_ns))
        except OSError:
            continue
    return max(found, key=lambda state: state.written, default=None)


def load_newest_model(folder: RunFolder, state: StateFile, device: torch.device) -> HairModel:
    """Read the hair model of a state.

    A fit writes its model when it ends or stops. Until then its checkpoint contains the model, except for the weights
    of the strand prior, which are those of the package.

    Raises:
        InputError: a file is damaged, or the run uses a strand prior of its own and has not written a model.
    """
    if state.path != folder.checkpoint:
        return load_hair_model(folder.model, device)
    described = read_description(folder)
    prior = fit_prior(None, torch.device("cpu"))
    if weights_digest(prior) != described.prior:
        raise InputError(
            f"{folder.path}: expected the strand prior that comes with the package, found a run with another one; "
            "wait until the fit has ended and written its model."
        )
    return load_checkpoint_model(folder.checkpoint, described.config.model, prior.generator).to(device)
