"""A hair model as one folder: `model.safetensors` (everything learned, the roots, the body) and `config.json`."""

import dataclasses
import json
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from neural_strands.foundation.configs import config_from_json
from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.files import atomic_folder
from neural_strands.foundation.json_files import JsonValue, check_format, read_json
from neural_strands.geometry.mesh import Mesh
from neural_strands.model import view_functions
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.prior.generator import GeneratorConfig, StrandGenerator
from neural_strands.scalp.roots import Roots

CONFIG_NAME = "config.json"
MODEL_NAME = "model"
"""Name of the model's folder inside a run."""
WEIGHTS_NAME = "model.safetensors"
FORMAT = 12
"""Version of the folder's layout and of what the networks see."""
ADVICE = "copy the folder again or fit anew"
SHAPES = {
    "root_position": "root 3",
    "root_uv": "root 2",
    "root_frame": "root 3 3",
    "body.vertices": "vertex 3",
    "body.faces": "face 3",
    "textures.shape": "texel texel latent",
    "textures.appearance": "colour_texel colour_texel feature",
    "textures.elsewhere": "colour_texel colour_texel feature",
    "textures.view": "view_function colour_texel colour_texel view_colour",
}
"""Tensors that are large or whose sizes depend on the capture; their shapes are checked before a model is built."""


def save_hair_model(model: HairModel, folder: Path, notes: dict[str, str] | None = None) -> None:
    """Write a model; an existing folder of that name is replaced.

    Args:
        model: the model to save.
        folder: where to write it.
        notes: how the model was made (command, capture, seed), written into `config.json`.

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


def find_hair_model(path: Path) -> Path:
    """The model's folder: the path itself if it holds a model, else `model` inside it (a run)."""
    return path if (path / CONFIG_NAME).is_file() else path / MODEL_NAME


def load_hair_model(folder: Path, device: torch.device | str = "cpu") -> HairModel:
    """Read a model that `save_hair_model` wrote, ready to render or to continue its fit.

    Raises:
        InputError: the folder is not a model, or is damaged.
    """
    for name in (CONFIG_NAME, WEIGHTS_NAME):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: expected a hair model's folder with {CONFIG_NAME} and {WEIGHTS_NAME}, found no {name}; "
                "name a folder that fit wrote, once the fit has ended."
            )
    described = read_json(folder / CONFIG_NAME, "the description of a hair model", ADVICE)
    check_format(described, FORMAT)
    config = config_from_json(HairModelConfig, described.member("model"))
    generator = _generator(described.member("generator"))
    try:
        tensors = load_file(folder / WEIGHTS_NAME)
    except (SafetensorError, OSError, ValueError) as error:
        raise _broken(folder / WEIGHTS_NAME, f"something else ({reason(error)})") from error
    _check_tensors(folder / WEIGHTS_NAME, tensors, config)
    return _model(folder, CONFIG_NAME, tensors, config, generator).to(device)


def _generator(written: JsonValue) -> StrandGenerator:
    config = config_from_json(GeneratorConfig, written)
    try:
        return StrandGenerator(config)
    except ValueError as error:
        raise written.refuse(f"sizes of a strand generator ({error})") from error


def hair_model_from_tensors(
    path: Path, tensors: dict[str, Tensor], config: HairModelConfig, generator: StrandGenerator
) -> HairModel:
    """Build a model from a state that lacks the generator's weights, as checkpoints store it.

    Args:
        path: the file that the tensors come from, for error messages.
        tensors: `state_dict` of the model without the entries of the generator.
        config: the model's configuration.
        generator: the strand generator that the model was fitted with.

    Raises:
        InputError: the tensors are not those of such a model, or are not finite.
    """
    _check_tensors(path, tensors, config)
    weights = {f"generator.{name}": value for name, value in generator.state_dict().items()}
    return _model(path, "the settings of its run", tensors | weights, config, generator)


def _model(
    path: Path, settings: str, tensors: dict[str, Tensor], config: HairModelConfig, generator: StrandGenerator
) -> HairModel:
    try:
        model = HairModel(config, _roots(tensors), generator, _body(tensors), torch.Generator())
        model.load_state_dict(tensors)
    except (RuntimeError, ValueError, TypeError, KeyError) as error:
        raise _broken(path, f"weights that do not fit {settings}: {reason(error)}") from error
    return model


def _check_tensors(path: Path, tensors: dict[str, Tensor], config: HairModelConfig) -> None:
    """Refuse tensors from which no model can be built, before one is built.

    Raises:
        InputError: a tensor is missing, is not finite, or has a shape that disagrees with the config or the other
            tensors.
    """
    textures, changes = config.textures, tensors.get("textures.view")
    sides = {
        "texel": textures.shape_size,
        "latent": textures.shape_channels,
        "colour_texel": textures.appearance_size,
        "view_function": 0 if changes is not None and changes.shape[:1] == (0,) else view_functions.COUNT,
        "view_colour": 3 * textures.appearance_knots,
        "feature": textures.appearance_channels * textures.appearance_knots,
    }
    for name, shape in SHAPES.items():
        found = tuple(tensors[name].shape) if name in tensors else ()
        axes = shape.split()
        if len(found) != len(axes) or any(
            side != (int(axis) if axis.isdigit() else sides.setdefault(axis, side))
            for axis, side in zip(axes, found, strict=True)
        ):
            expected = ", ".join(str(sides.get(axis, axis)) for axis in axes)
            raise _broken(path, f"{name} of shape {found or 'none'} in place of ({expected})")
    for name, value in tensors.items():
        if value.is_floating_point() and not value.isfinite().all():
            raise _broken(path, f"NaN or infinity in {name}")
    faces, count = tensors["body.faces"], len(tensors["body.vertices"])
    if faces.dtype != torch.int64 or (faces.numel() and not 0 <= int(faces.min()) <= int(faces.max()) < count):
        raise _broken(path, f"faces beyond the body's {count} vertices")


def _broken(path: Path, found: str) -> InputError:
    return InputError(f"{path}: expected a complete hair model, found {found}; {ADVICE}.")


def _roots(tensors: dict[str, Tensor]) -> Roots:
    position = tensors["root_position"]
    return Roots(position, tensors["root_uv"], tensors["root_frame"], position.new_zeros(len(position)))


def _body(tensors: dict[str, Tensor]) -> Mesh:
    return Mesh(tensors["body.vertices"], tensors["body.faces"])
