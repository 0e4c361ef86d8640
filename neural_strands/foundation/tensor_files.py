"""Tensors in files: safetensors with the same bytes every time, and files of `torch.save`, read without trusting them.

Of the latter only tensors and plain values are read, and only in the expected structure.
"""

import json
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from torch import Tensor

from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.foundation.input_files import check_file


def safetensors_bytes(tensors: Mapping[str, Tensor], notes: Mapping[str, str]) -> bytes:
    """The contents of a safetensors file, with its notes in the order of their names.

    The library writes notes in an order of its own, which differs from call to call.
    """
    written = safetensors.torch.save(dict(tensors), dict(notes))
    end = 8 + int.from_bytes(written[:8], "little")
    header = json.loads(written[8:end])
    header["__metadata__"] = dict(sorted(header.get("__metadata__", {}).items()))
    ordered = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    # The data begin at a multiple of eight bytes.
    ordered += b" " * (-len(ordered) % 8)
    return len(ordered).to_bytes(8, "little") + ordered + written[end:]


def read_tensors(path: Path, what: str, advice: str, with_older_format: bool = False) -> Any:
    """Read a file of `torch.save` onto the CPU; only tensors and plain values are unpickled.

    Args:
        path: the file.
        what: expected content, for the error message, such as "this fit's checkpoint".
        advice: what to do where it holds something else.
        with_older_format: whether torch's older format, which is not an archive, is read too; it trusts the sizes that
            a file claims.

    Raises:
        InputError: the file cannot be read, or contains something else.
    """
    check_file(path, what)
    try:
        # This check itself can fail for a damaged file.
        whole = with_older_format or zipfile.is_zipfile(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = torch.load(path, map_location="cpu", weights_only=True) if whole else None
    except Exception as error:
        # The unpickler, zipfile and torch's own reader raise a dozen kinds, from UnpicklingError to AttributeError.
        raise InputError(f"{path}: expected {what}, found something else ({reason(error)}); {advice}.") from error
    if not whole:
        raise InputError(f"{path}: expected {what}, found something else (no archive of tensors); {advice}.")
    return content


def difference(found: Any, expected: Any, place: str) -> str | None:
    """Describe where a structure differs from the expected one; None if it does not.

    Dictionaries must have the same keys, lists the same length, tensors the same shape and type, and everything else
    the same type. An expected Adam optimiser stands for its `adam_state`, in which moments of parameters that have had
    no gradient so far may be missing.

    Args:
        found: the content of a file.
        expected: a structure of the right kind, of any values.
        place: name in messages, such as "checkpoint".
    """
    if isinstance(expected, torch.optim.Adam):
        return difference(found, _adam_state(found, expected), place)
    if isinstance(expected, Tensor):
        if isinstance(found, Tensor) and (found.shape, found.dtype) == (expected.shape, expected.dtype):
            return None
        held = f"{found.dtype} {tuple(found.shape)}" if isinstance(found, Tensor) else excerpt(found)
        return f"{held} in place of {expected.dtype} {tuple(expected.shape)} as {place}"
    if type(found) is not type(expected):
        return f"{excerpt(found)} in place of a {type(expected).__name__} as {place}"
    if isinstance(expected, list | tuple):
        found, expected = dict(enumerate(found)), dict(enumerate(expected))
    if isinstance(expected, dict):
        odd = next((key for key in {**found, **expected} if (key in found) != (key in expected)), None)
        if odd is not None:
            return f"{'a surplus' if odd in found else 'no'} {excerpt(odd)} in {place}"
        parts = (difference(found[key], value, f"{place}[{excerpt(key)}]") for key, value in expected.items())
        return next((part for part in parts if part is not None), None)
    return None


def adam_state(optimiser: torch.optim.Adam) -> dict[str, Any]:
    """An optimiser's `state_dict` without `fused`, which depends on the device rather than on the state."""
    content = optimiser.state_dict()
    groups = [{name: value for name, value in group.items() if name != "fused"} for group in content["param_groups"]]
    return content | {"param_groups": groups}


def restore_adam(optimiser: torch.optim.Adam, content: dict[str, Any]) -> None:
    """Restore what `adam_state` returned; the optimiser stays fused or not, as it was."""
    fused = [group["fused"] for group in optimiser.param_groups]
    optimiser.load_state_dict(content)
    for group, value in zip(optimiser.param_groups, fused, strict=True):
        group["fused"] = value


def _adam_state(found: Any, optimiser: torch.optim.Adam) -> dict[str, Any]:
    """The structure of an optimiser's state, with moments for those parameters that `found` has moments of."""
    parameters = [parameter for group in optimiser.param_groups for parameter in group["params"]]
    stored = found.get("state") if isinstance(found, dict) else None
    moments = {
        k: {"step": torch.zeros(()), "exp_avg": parameter, "exp_avg_sq": parameter}
        for k, parameter in enumerate(parameters)
        if isinstance(stored, dict) and k in stored
    }
    return {"state": moments, "param_groups": adam_state(optimiser)["param_groups"]}
