"""Checkpoints of a fit: one file, whole or absent, from which a fit goes on as if it had never stopped."""

from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import torch

from neural_strands.fitting.fit import FitState
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file, tensor_bytes


def save_checkpoint(state: FitState, path: Path) -> None:
    """Write what a fit needs to go on.

    Raises:
        InputError: the disk is full or cannot be written to, or the fit has diverged; an older checkpoint stays.
    """
    learned = {name: value for name, value in state.model.state_dict().items() if not name.startswith("generator.")}
    content = {
        "model": learned,
        "optimiser": state.optimiser.state_dict(),
        "remembered": state.remembered,
        "drawn": state.drawn,
        "first": state.first,
        "step": state.step,
    }
    if (name := _not_finite(content)) is not None:
        raise InputError(f"the fit diverged: NaN in {name} after step {state.step}; {path} stays as it was.")
    with atomic_file(path) as temporary:
        temporary.write_bytes(tensor_bytes(content))


def load_checkpoint(state: FitState, path: Path) -> None:
    """Put a fit where the checkpoint left it; `state` was started with the same config.

    Raises:
        InputError: the file is not whole, is of another fit, or holds NaN.
    """
    device = state.remembered.device
    try:
        # Adam counts its steps on the CPU; on the device every count would be waited for at every step.
        content = torch.load(path, map_location="cpu", weights_only=True)
        learned = content["model"]
        if (name := _not_finite(content)) is not None:
            raise InputError(f"{path}: expected finite numbers, came NaN in {name}; delete the file to start anew.")
        missing, unexpected = state.model.load_state_dict(learned, strict=False)
        if unexpected or any(not name.startswith("generator.") for name in missing):
            raise KeyError(f"weights {[*unexpected, *missing][:3]} do not fit")
        state.optimiser.load_state_dict(content["optimiser"])
        state.remembered, state.drawn = content["remembered"].to(device), content["drawn"].to(device)
        state.first = content["first"].to(device)
        state.step = int(content["step"])
    except (KeyError, ValueError, RuntimeError, EOFError, OSError, UnpicklingError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:160]
        raise InputError(
            f"{path}: expected this fit's checkpoint, whole, came something else ({reason}); delete it to start anew."
        ) from error


def _not_finite(content: dict[str, Any]) -> str | None:
    """The first part of a checkpoint that holds NaN or infinity, if any does."""
    moments = [
        (f"the optimiser's {name}", value)
        for of_one in content["optimiser"]["state"].values()
        for name, value in of_one.items()
    ]
    strands = [(name, content[name]) for name in ("remembered", "drawn", "first")]
    parts = [*content["model"].items(), *moments, *strands]
    return next((name for name, value in parts if value.is_floating_point() and not value.isfinite().all()), None)
