"""Checkpoints of a fit: one file, written atomically, from which a fit resumes as if it had never stopped."""

from pathlib import Path
from typing import Any

from torch import Tensor

from neural_strands.fitting.fit import FitState
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file, tensor_bytes
from neural_strands.foundation.tensor_files import adam_state, difference, read_tensors, restore_adam
from neural_strands.model.files import hair_model_from_tensors
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.prior.generator import StrandGenerator

ADVICE = "delete it to start again"


def save_checkpoint(state: FitState, path: Path) -> None:
    """Write the state from which a fit resumes.

    Raises:
        InputError: the file cannot be written, or the fit has diverged; an older checkpoint is left unchanged.
    """
    content = _content(state)
    if (name := _not_finite(content)) is not None:
        raise InputError(f"the fit diverged: NaN in {name} after step {state.step}; {path} stays as it was.")
    with atomic_file(path) as temporary:
        temporary.write_bytes(tensor_bytes(content))


def load_checkpoint(state: FitState, path: Path) -> None:
    """Restore a fit from its checkpoint; `state` must have been started with the same config.

    Raises:
        InputError: the file is damaged, belongs to another fit, or contains NaN.
    """
    device = state.remembered.device
    # Adam's step counters stay on the CPU; on the device, each would cost a synchronisation per step.
    content = read_tensors(path, "this fit's checkpoint, whole", ADVICE)
    fault = difference(content, _content(state) | {"optimiser": state.optimiser}, "checkpoint")
    if fault is None and content["step"] < 0:
        fault = f"step {content['step']}"
    if fault is not None:
        raise InputError(f"{path}: expected this fit's complete checkpoint, found {fault}; {ADVICE}.")
    if (name := _not_finite(content)) is not None:
        raise InputError(f"{path}: expected finite numbers, found NaN in {name}; {ADVICE}.")
    state.model.load_state_dict(content["model"], strict=False)
    restore_adam(state.optimiser, content["optimiser"])
    state.show(content["drawn"].to(device))
    state.remembered, state.first = content["remembered"].to(device), content["first"].to(device)
    state.seen = content["seen"].to(device)
    state.step = content["step"]


def load_checkpoint_model(path: Path, config: HairModelConfig, generator: StrandGenerator) -> HairModel:
    """Read only the hair model from a checkpoint, to look at it while the fit is running.

    Args:
        path: the checkpoint.
        config: the model's configuration, from the run's description.
        generator: the strand generator that the fit uses.

    Raises:
        InputError: the file is damaged, belongs to another fit, or contains NaN.
    """
    content = read_tensors(path, "a fit's checkpoint, whole", ADVICE)
    tensors = content.get("model") if isinstance(content, dict) else None
    if not isinstance(tensors, dict) or not all(isinstance(value, Tensor) for value in tensors.values()):
        raise InputError(f"{path}: expected a fit's complete checkpoint, found no hair model in it; {ADVICE}.")
    return hair_model_from_tensors(path, tensors, config, generator)


def _content(state: FitState) -> dict[str, Any]:
    """The contents of a checkpoint; the generator's weights are left out because they never change."""
    learned = {name: value for name, value in state.model.state_dict().items() if not name.startswith("generator.")}
    return {
        "model": learned,
        "optimiser": adam_state(state.optimiser),
        "remembered": state.remembered,
        "drawn": state.drawn,
        "first": state.first,
        "seen": state.seen,
        "step": state.step,
    }


def _not_finite(content: dict[str, Any]) -> str | None:
    """Name of the first part that contains NaN or infinity, if any does."""
    moments = [
        (f"the optimiser's {name}", value)
        for of_one in content["optimiser"]["state"].values()
        for name, value in of_one.items()
    ]
    strands = [(name, content[name]) for name in ("remembered", "drawn", "first")]
    parts = [*content["model"].items(), *moments, *strands]
    return next((name for name, value in parts if value.is_floating_point() and not value.isfinite().all()), None)
