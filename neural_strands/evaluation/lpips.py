"""LPIPS v0.1 (Zhang et al. 2018): distance between images in the features of a trained trunk; differentiable."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.evaluation.image_metrics import masked_mean
from neural_strands.evaluation.lpips_trunks import LAYOUTS, Network, build_trunk
from neural_strands.evaluation.lpips_weights import HEADS, TRUNKS, load_heads, load_trunk
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.published_files import find_file

SHIFT = (-0.030, -0.088, -0.188)
"""Mean colour of the trunks' training images, for images in [-1, 1]."""
SCALE = (0.458, 0.448, 0.450)
"""Standard deviation of colour of the trunks' training images, for images in [-1, 1]."""
TINY = 1e-10
"""Added to the length of a feature vector before the division by it."""
TRAINING_NETWORK: Network = "squeeze"
"""The network used as a training loss by fits."""
SMALLEST_SIDE = 32
"""Smallest side of an image, pixels; in smaller ones the deepest features would consist of padding."""


class Lpips(nn.Module):
    """The metric with its weights, frozen.

    Attributes:
        network: name of the trunk.
    """

    def __init__(self, network: Network, trunk: dict[str, Tensor], heads: Sequence[Tensor]) -> None:
        """Build the metric from a trunk's state dict and the channels' weights at each tap (see `lpips_weights`)."""
        super().__init__()
        self.network: Network = network
        self.trunk = build_trunk(network)
        self.trunk.load_state_dict(trunk)
        self.heads = nn.ParameterList(heads)
        self.register_buffer("shift", torch.tensor(SHIFT)[:, None, None], persistent=False)
        self.register_buffer("scale", torch.tensor(SCALE)[:, None, None], persistent=False)
        self.requires_grad_(False)
        self.eval()

    def forward(
        self,
        image: Float[Tensor, "*batch height width 3"],
        reference: Float[Tensor, "*batch height width 3"],
        mask: Float[Tensor, "*batch height width"] | None = None,
    ) -> Float[Tensor, "*batch"]:
        """Distance of images in [0, 1] (sRGB): 0 for equal ones.

        With a mask, each tap's map of distances is averaged with the mask as weight, with the mask averaged to the
        resolution of the map; an empty mask gives NaN. Features near the mask's border see some of the surroundings.

        Raises:
            ValueError: the image is smaller than 32 pixels.
        """
        if min(image.shape[-3:-1]) < SMALLEST_SIDE:
            raise ValueError(
                f"LPIPS needs images of at least {SMALLEST_SIDE} pixels per side, found {tuple(image.shape)}"
            )
        batch = image.shape[:-3]
        size = image.shape[-3:-1]
        stacked = torch.stack([image, reference]).movedim(-1, -3).reshape(-1, 3, *size)
        weights = None if mask is None else mask.reshape(-1, *size)
        total = image.new_zeros(stacked.shape[0] // 2)
        for features, head in zip(self.features(stacked), self.heads, strict=True):
            unit = features / (features.square().sum(dim=1, keepdim=True).add(TINY**2).sqrt() + TINY)
            a, b = unit.chunk(2)
            distance = ((a - b).square() * head[:, None, None]).sum(dim=1)
            if weights is None:
                total = total + distance.mean(dim=(-2, -1))
            else:
                coarse = torch.nn.functional.adaptive_avg_pool2d(weights[:, None], distance.shape[-2:])[:, 0]
                total = total + masked_mean(distance, coarse)
        return total.reshape(batch)

    def features(self, images: Float[Tensor, "batch 3 height width"]) -> list[Float[Tensor, "batch channel h w"]]:
        """Features of images in [0, 1] at each tap."""
        x = (2 * images - 1 - self.get_buffer("shift")) / self.get_buffer("scale")
        taps = LAYOUTS[self.network].taps
        found = []
        for number, layer in enumerate(self.trunk):
            x = layer(x)
            if number in taps:
                found.append(x)
        return found

    def train(self, mode: bool = True) -> "Lpips":
        """Stay in evaluation mode; the metric is never trained."""
        del mode
        return super().train(False)


def training_note(network: Network) -> str:
    """A caveat for figures of the network that fits are trained with; empty for the others."""
    if network != TRAINING_NETWORK:
        return ""
    return f"LPIPS ({network}) is also a training loss of `neural-strands fit`: it favours what a fit has made."


def find_lpips(
    network: Network = "squeeze", device: torch.device | str = "cpu", fetch: bool = True
) -> tuple[Lpips | None, str]:
    """Find the metric; returns it and an empty string, or None and a sentence with the reason.

    Weights come from the folder named by NEURAL_STRANDS_WEIGHTS, from the user's cache, or (with `fetch`) once from
    their official addresses into the cache. After a download that failed, there is none for an hour.
    """
    try:
        trunk = load_trunk(network, find_file(TRUNKS[network], fetch, is_required=False))
        heads = load_heads(network, find_file(HEADS[network], fetch, is_required=False))
    except InputError as error:
        return None, f"LPIPS ({network}) is absent: {error}"
    return Lpips(network, trunk, heads).to(device), ""
