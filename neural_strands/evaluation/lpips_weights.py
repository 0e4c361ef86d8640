"""The published weights of LPIPS: where they are found, and how they are read.

Only tensors are unpickled. The file names of torchvision's weights carry the first eight digits of their sha256.
"""

from pathlib import Path

import torch
from torch import Tensor

from neural_strands.evaluation.lpips_trunks import LAYOUTS, Network, build_trunk
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.published_files import PublishedFile
from neural_strands.foundation.tensor_files import read_tensors

ADVICE = "replace it with the published file"
HEADS_ADDRESS = (
    "https://raw.githubusercontent.com/richzhang/PerceptualSimilarity/"
    "082bb24f84c091ea94de2867d34c4544f68e0963/lpips/weights/v0.1"
)
TRUNKS_ADDRESS = "https://download.pytorch.org/models"

TRUNKS: dict[Network, PublishedFile] = {
    "squeeze": PublishedFile(
        ("squeezenet1_1-b8a52dc0.pth", "squeeze.backbone.pth"),
        f"{TRUNKS_ADDRESS}/squeezenet1_1-b8a52dc0.pth",
        "b8a52dc0",
    ),
    "alex": PublishedFile(
        ("alexnet-owt-7be5be79.pth", "alex.backbone.pth"), f"{TRUNKS_ADDRESS}/alexnet-owt-7be5be79.pth", "7be5be79"
    ),
    "vgg": PublishedFile(
        ("vgg16-397923af.pth", "vgg.backbone.pth"), f"{TRUNKS_ADDRESS}/vgg16-397923af.pth", "397923af"
    ),
}
HEADS: dict[Network, PublishedFile] = {
    "squeeze": PublishedFile(
        ("lin_squeeze_v0.1.pth", "squeeze.pth"),
        f"{HEADS_ADDRESS}/squeeze.pth",
        "4a5350f23600cb79923ce65bb07cbf57dca461329894153e05a1346bd531cf76",
    ),
    "alex": PublishedFile(
        ("lin_alex_v0.1.pth", "alex.pth"),
        f"{HEADS_ADDRESS}/alex.pth",
        "df73285e35b22355a2df87cdb6b70b343713b667eddbda73e1977e0c860835c0",
    ),
    "vgg": PublishedFile(
        ("lin_vgg_v0.1.pth", "vgg.pth"),
        f"{HEADS_ADDRESS}/vgg.pth",
        "a78928a0af1e5f0fcb1f3b9e8f8c3a2a5a3de244d830ad5c1feddc79b8432868",
    ),
}


def load_trunk(network: Network, path: Path) -> dict[str, Tensor]:
    """Read a trunk's weights, with or without the prefix `features.`; the classifier and unused layers are dropped.

    Raises:
        InputError: the file holds other tensors, or anything but tensors.
    """
    stored = {name.removeprefix("features."): value for name, value in _load(path).items()}
    return _chosen(path, stored, build_trunk(network).state_dict())


def load_heads(network: Network, path: Path) -> list[Tensor]:
    """Read the linear heads: one non-negative weight per channel for each tap.

    Raises:
        InputError: the file holds other tensors, or anything but tensors.
    """
    channels = LAYOUTS[network].channels
    wanted = {f"lin{k}.model.1.weight": torch.zeros(1, count, 1, 1) for k, count in enumerate(channels)}
    return [value.reshape(-1) for value in _chosen(path, _load(path), wanted).values()]


def _load(path: Path) -> dict[str, Tensor]:
    # The published heads are in torch's older format.
    stored = read_tensors(path, "weights of LPIPS", ADVICE, with_older_format=True)
    if not isinstance(stored, dict) or not all(isinstance(value, Tensor) for value in stored.values()):
        raise InputError(f"{path}: expected a dictionary of tensors, found {type(stored).__name__}; {ADVICE}.")
    return stored


def _chosen(path: Path, stored: dict[str, Tensor], wanted: dict[str, Tensor]) -> dict[str, Tensor]:
    for name, value in wanted.items():
        if name not in stored or stored[name].shape != value.shape:
            shape = tuple(stored[name].shape) if name in stored else "none"
            raise InputError(
                f"{path}: expected {name} of shape {tuple(value.shape)}, found {shape}; take another file."
            )
    return {name: stored[name].float() for name in wanted}
