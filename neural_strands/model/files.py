"""A hair model as one folder: `model.safetensors` (everything learned, the roots, the body) and `config.json`."""

import dataclasses
import json
import typing
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_folder
from neural_strands.geometry.mesh import Mesh
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.prior.generator import GeneratorConfig, StrandGenerator
from neural_strands.scalp.roots import Roots

CONFIG_NAME = "config.json"
WEIGHTS_NAME = "model.safetensors"
FORMAT = 5
"""Version of the folder's layout."""

C = TypeVar("C")


def save_hair_model(model: HairModel, folder: Path, notes: dict[str, str] | None = None) -> None:
    """Write a model; a folder of that name is replaced as a whole.

    Args:
        model: what to save.
        folder: where.
        notes: how the model was made (command, capture, seed), kept in `config.json`.

    Raises:
        InputError: the folder cannot be written.
    """
    described = {
        "format": FORMAT,
        "model": dataclasses.asdict(model.config),
        "generator": dataclasses.asdict(model.generator.config),
        "notes": notes or {},
    }
    tensors = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    with atomic_folder(folder) as temporary:
        (temporary / CONFIG_NAME).write_text(json.dumps(described, indent=2) + "\n", encoding="utf-8")
        (temporary / WEIGHTS_NAME).write_bytes(save(tensors))


def load_hair_model(folder: Path, device: torch.device | str = "cpu") -> HairModel:
    """Read a model that `save_hair_model` wrote, on any machine, ready to render or to fit further.

    Raises:
        InputError: not a model's folder, or not whole.
    """
    for name in (CONFIG_NAME, WEIGHTS_NAME):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: expected a hair model's folder with {CONFIG_NAME} and {WEIGHTS_NAME}, found no {name}; "
                "name the folder that fit wrote."
            )
    try:
        described = json.loads((folder / CONFIG_NAME).read_text(encoding="utf-8"))
        if described["format"] != FORMAT:
            raise InputError(
                f"{folder / CONFIG_NAME}: expected format {FORMAT}, came {described['format']}; "
                "use the version of neural-strands that wrote it."
            )
        config = from_plain(HairModelConfig, described["model"])
        generator = StrandGenerator(from_plain(GeneratorConfig, described["generator"]))
        tensors = load_file(folder / WEIGHTS_NAME)
        model = HairModel(config, _roots(tensors), generator, _body(tensors), torch.Generator())
        model.load_state_dict(tensors)
    except (SafetensorError, KeyError, TypeError, ValueError, RuntimeError, OSError) as error:
        reason = str(error).splitlines()[0][:160] if str(error) else type(error).__name__
        raise InputError(
            f"{folder}: expected a whole hair model, found something else ({reason}); copy it again or fit anew."
        ) from error
    return model.to(device)


def from_plain(kind: type[C], values: dict[str, Any]) -> C:
    """Rebuild a config dataclass, with those inside it, from what `dataclasses.asdict` and JSON made of it.

    Raises:
        TypeError: a field that the dataclass does not have.
    """
    hints = typing.get_type_hints(kind)
    return kind(**{name: _value(hints.get(name), value) for name, value in values.items()})


def _value(hint: Any, value: Any) -> Any:
    if isinstance(value, list):
        inner = typing.get_args(hint)[:1] or (None,)
        return tuple(_value(inner[0], each) for each in value)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type) and isinstance(value, dict):
        return from_plain(hint, value)
    return value


def _roots(tensors: dict[str, Tensor]) -> Roots:
    position = tensors["root_position"]
    return Roots(position, tensors["root_uv"], tensors["root_frame"], position.new_zeros(len(position)))


def _body(tensors: dict[str, Tensor]) -> Mesh:
    return Mesh(tensors["body.vertices"], tensors["body.faces"], tensors.get("body.corner_uv"))
