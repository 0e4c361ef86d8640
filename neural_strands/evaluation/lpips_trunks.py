"""The convolutional trunks of LPIPS, with layers named as in torchvision's published state dicts (`features.*`).

AlexNet (Krizhevsky 2014), VGG-16 (Simonyan and Zisserman 2015), SqueezeNet 1.1 (Iandola et al. 2016).
"""

from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

Network = Literal["squeeze", "alex", "vgg"]


@dataclass(frozen=True)
class TrunkLayout:
    """Layers after which features are taken, and their numbers of channels."""

    taps: tuple[int, ...]
    channels: tuple[int, ...]


LAYOUTS: dict[Network, TrunkLayout] = {
    "alex": TrunkLayout((1, 4, 7, 9, 11), (64, 192, 384, 256, 256)),
    "vgg": TrunkLayout((3, 8, 15, 22, 29), (64, 128, 256, 512, 512)),
    "squeeze": TrunkLayout((1, 4, 7, 9, 10, 11, 12), (64, 128, 256, 384, 384, 512, 512)),
}
"""The taps of LPIPS v0.1 (Zhang et al. 2018): after a rectifier or a Fire module, before the next stage."""


class Fire(nn.Module):
    """SqueezeNet's module: a 1 x 1 squeeze, then 1 x 1 and 3 x 3 expansions side by side."""

    def __init__(self, incoming: int, squeezed: int, expanded: int) -> None:
        """Each of the two expansions has `expanded` output channels."""
        super().__init__()
        self.squeeze = nn.Conv2d(incoming, squeezed, 1)
        self.expand1x1 = nn.Conv2d(squeezed, expanded, 1)
        self.expand3x3 = nn.Conv2d(squeezed, expanded, 3, padding=1)

    def forward(self, x: Float[Tensor, "batch channel height width"]) -> Float[Tensor, "batch out height width"]:
        """Return the two expansions, rectified and concatenated."""
        x = torch.relu(self.squeeze(x))
        return torch.cat([torch.relu(self.expand1x1(x)), torch.relu(self.expand3x3(x))], dim=1)


def build_trunk(network: Network) -> nn.Sequential:
    """Return the layers up to the last tap, without loading weights."""
    layers = {"alex": _alexnet, "vgg": _vgg16, "squeeze": _squeezenet}[network]()
    return nn.Sequential(*layers[: LAYOUTS[network].taps[-1] + 1])


def _alexnet() -> list[nn.Module]:
    return [
        nn.Conv2d(3, 64, 11, stride=4, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, stride=2),
        nn.Conv2d(64, 192, 5, padding=2),
        nn.ReLU(),
        nn.MaxPool2d(3, stride=2),
        nn.Conv2d(192, 384, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(384, 256, 3, padding=1),
        nn.ReLU(),
        nn.Conv2d(256, 256, 3, padding=1),
        nn.ReLU(),
    ]


def _vgg16() -> list[nn.Module]:
    layers: list[nn.Module] = []
    incoming = 3
    for width, depth in ((64, 2), (128, 2), (256, 3), (512, 3), (512, 3)):
        for _ in range(depth):
            layers += [nn.Conv2d(incoming, width, 3, padding=1), nn.ReLU()]
            incoming = width
        layers.append(nn.MaxPool2d(2))
    return layers


def _squeezenet() -> list[nn.Module]:
    def pool() -> nn.Module:
        return nn.MaxPool2d(3, stride=2, ceil_mode=True)

    return [
        nn.Conv2d(3, 64, 3, stride=2),
        nn.ReLU(),
        pool(),
        Fire(64, 16, 64),
        Fire(128, 16, 64),
        pool(),
        Fire(128, 32, 128),
        Fire(256, 32, 128),
        pool(),
        Fire(256, 48, 192),
        Fire(384, 48, 192),
        Fire(384, 64, 256),
        Fire(512, 64, 256),
    ]
