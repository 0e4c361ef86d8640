"""Weights of a model's networks, image generator and point shader, from which other fits start.

What the networks learn, such as how strands become an image with opaque hair and sharp locks, hardly depends on the
person. The package has weights that have learned it from synthetic hair, in the sizes of the presets `fast` and `demo`.
"""

import json
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.files import atomic_file
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.shading import PointShading
from neural_strands.model.unet import UNet

Networks = dict[str, Tensor]
"""Weights by their names in a model's state."""

SHIPPED = Path(__file__).with_name("weights")
"""Folder of the package's weights."""
PREFIXES = ("unet.", "shading.")
"""What the names of the networks' weights begin with in a model's state."""
ADVICE = "name a file that train-networks wrote, or the model.safetensors of a run with networks of the same sizes"


def save_networks(model: HairModel, path: Path, notes: dict[str, str] | None = None) -> None:
    """Write the weights of a model's networks (safetensors).

    Args:
        model: whose networks.
        path: where to write them; an existing file is replaced.
        notes: how they were made, kept in the file.

    Raises:
        InputError: the file cannot be written.
    """
    state = model.state_dict()
    tensors = {name: value.cpu().contiguous() for name, value in state.items() if name.startswith(PREFIXES)}
    with atomic_file(path) as temporary:
        temporary.write_bytes(save(tensors, {"notes": json.dumps(notes or {}, sort_keys=True)}))


def read_networks(path: Path, config: HairModelConfig) -> Networks:
    """Read the weights of networks.

    Args:
        path: file of networks, or the weights of a whole model.
        config: of the model that they are for.

    Raises:
        InputError: the file is missing or damaged, or its networks have other sizes.
    """
    networks = _read(path)
    if (misfit := _misfit(networks, config)) is not None:
        raise InputError(f"{path}: expected networks of this fit's sizes, found {misfit}; {ADVICE}.")
    return networks


def shipped_networks(config: HairModelConfig) -> Networks | None:
    """The package's weights for the networks of a model; None if it has none of their sizes."""
    path = SHIPPED / f"networks_{'_'.join(str(width) for width in config.unet.widths)}.safetensors"
    if not path.is_file():
        return None
    networks = _read(path)
    return networks if _misfit(networks, config) is None else None


def start_networks(model: HairModel, networks: Networks) -> None:
    """Replace the weights of a model's networks, in place."""
    own = model.state_dict()
    with torch.no_grad():
        for name, value in networks.items():
            own[name].copy_(value)


def leave_colours(model: HairModel) -> None:
    """Let the networks leave the colours of the textures as they are, in place, until they learn to change them.

    Colours in closed form are nearer to the photographs than after the changes that networks have learned elsewhere.
    Hidden layers, and what the generator does to opacity, stay.
    """
    with torch.no_grad():
        model.shading.outer.zero_()
        model.unet.output[:3].zero_()
        model.unet.bias[:3].zero_()


def _read(path: Path) -> Networks:
    """The networks' weights in a file; nothing else in it is read."""
    if not path.is_file():
        raise InputError(f"{path}: expected weights of networks, found no file; {ADVICE}.")
    try:
        with safe_open(path, framework="pt") as file:
            names = [name for name in file.keys() if name.startswith(PREFIXES)]  # noqa: SIM118
            networks = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(
            f"{path}: expected weights of networks, found something else ({reason(error)}); {ADVICE}."
        ) from error
    if (name := next((n for n, v in networks.items() if not v.isfinite().all()), None)) is not None:
        raise InputError(f"{path}: expected finite weights, found NaN or infinity in {name}; {ADVICE}.")
    return networks


def _misfit(networks: Networks, config: HairModelConfig) -> str | None:
    """What keeps weights from being those of a model's networks; None if they fit."""
    random = torch.Generator()
    wanted = {
        "unet.": UNet(config.descriptor_channels, config.unet, random),
        "shading.": PointShading(config.textures.appearance_channels, config.shading, random),
    }
    expected = {prefix + name: value for prefix, part in wanted.items() for name, value in part.state_dict().items()}
    for name in sorted(expected.keys() | networks.keys()):
        if name not in networks:
            return f"none named {name}"
        if name not in expected:
            return f"another one, {name}"
        found, value = networks[name], expected[name]
        if found.shape != value.shape or found.dtype != value.dtype:
            return f"{name} of {tuple(found.shape)} {found.dtype} instead of {tuple(value.shape)} {value.dtype}"
    return None
