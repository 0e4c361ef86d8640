"""Modulators: networks that map a latent to the raw quantities behind amplitude, frequency and phase.

`CouplingModulator` is a stack of affine coupling layers (Dinh et al. 2017, "Density estimation using Real NVP"). It is
invertible, so the encoder's closed-form quantities have an exact latent. It is trained until the latents of the
training curves are standard normal; a sample of N(0, I) is then a strand like the training curves. `MlpModulator` is
the paper's: the latent is fed to every layer, as in its authors' later code.
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

STEEPEST = 2.0
"""Bound of the logarithm of a coupling layer's scale, which keeps the map from latent to strand well conditioned."""


class CouplingModulator(nn.Module):
    """Affine coupling layers over random permutations of the latent; the identity before training."""

    def __init__(self, latent: int, hidden: int, layers: int) -> None:
        super().__init__()
        if latent % 2:
            raise ValueError(f"coupling layers need an even latent, found {latent}")
        self.kept = latent // 2
        order = torch.Generator().manual_seed(0)
        orders = torch.stack([torch.arange(latent)] + [torch.randperm(latent, generator=order) for _ in range(layers)])[
            1:
        ]
        total = torch.arange(latent)
        for each in orders:
            total = total[each]
        self.order: Int64[Tensor, "layer latent"]
        self.restore: Int64[Tensor, " latent"]
        self.register_buffer("order", orders)
        self.register_buffer("restore", torch.argsort(total))
        self.networks = nn.ModuleList(_network(self.kept, hidden, latent) for _ in range(layers))

    def forward(self, latent: Float[Tensor, "strand latent"]) -> Float[Tensor, "strand latent"]:
        """Map latents to whitened raw quantities."""
        if not self.networks:
            return latent
        # One row per channel, so that selecting channels copies whole rows.
        value = latent.T
        for order, network in zip(self.order, self.networks, strict=True):
            value = value[order]
            kept, changed = value.split(self.kept)
            scale, shift = _affine(network, kept)
            value = torch.cat([kept, changed * scale.exp() + shift])
        return value[self.restore].T

    def inverse(
        self, value: Float[Tensor, "strand latent"]
    ) -> tuple[Float[Tensor, "strand latent"], Float[Tensor, " strand"]]:
        """Map whitened raw quantities to latents; also returns the log volume change d latent / d value."""
        log_volume = value.new_zeros(len(value))
        value = value.T[torch.argsort(self.restore)]
        for order, network in reversed(list(zip(self.order, self.networks, strict=True))):
            kept, changed = value.split(self.kept)
            scale, shift = _affine(network, kept)
            value = torch.cat([kept, (changed - shift) * (-scale).exp()])[torch.argsort(order)]
            log_volume = log_volume - scale.sum(dim=0)
        return value.T, log_volume


def _affine(
    network: nn.Module, kept: Float[Tensor, "kept strand"]
) -> tuple[Float[Tensor, "changed strand"], Float[Tensor, "changed strand"]]:
    """Log scale, softly bounded by `STEEPEST`, and shift, computed by the network from the kept channels."""
    hidden = kept
    for layer in network.children():
        hidden = (
            torch.addmm(layer.bias[:, None], layer.weight, hidden) if isinstance(layer, nn.Linear) else layer(hidden)
        )
    scale, shift = hidden.chunk(2)
    return scale / (1 + scale.abs() / STEEPEST), shift


def _network(taken: int, hidden: int, given: int) -> nn.Sequential:
    """Two hidden layers and a last layer initialised to zero."""
    last = nn.Linear(hidden, given)
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(nn.Linear(taken, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU(), last)


class MlpModulator(nn.Module):
    """The paper's modulator: layers with SiLU, the latent concatenated again at each; added to the identity."""

    def __init__(self, latent: int, hidden: int, layers: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            nn.Linear(latent if layer == 0 else hidden + latent, hidden) for layer in range(layers)
        )
        self.last = nn.Linear(hidden, latent)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, latent: Float[Tensor, "strand latent"]) -> Float[Tensor, "strand latent"]:
        """Map latents to raw quantities, before the linear map."""
        hidden = latent
        for index, layer in enumerate(self.layers):
            taken = latent if index == 0 else torch.cat([hidden, latent], dim=1)
            hidden = torch.nn.functional.silu(layer(taken))
        return latent + self.last(hidden)
