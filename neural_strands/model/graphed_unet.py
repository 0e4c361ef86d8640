"""Runs the image generator through CUDA graphs, because the host takes longer to queue its kernels than they run.

A graph repeats the same kernels on the same memory, so there is one for each set of sizes, and it is recorded once
these have come often enough. Weights may change between calls, but not where they lie in memory.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from neural_strands.foundation.kernels import is_traced
from neural_strands.model.unet import UNet

Run = Callable[..., Tensor]
"""Takes the maps of all levels."""
OFTEN = 3
"""Number of calls with the same sizes after which a graph is recorded; recording takes as long as some ten calls."""
MOST = 2
"""Number of graphs that are kept: each holds the memory of all that it computes."""


class GraphedUNet:
    """An image generator, and the graphs of its recent calls.

    Attributes:
        unet: the generator.
        in_turn: whether each picture with gradients is back-propagated before the next is rendered, as in a fit. Only
            then may these be graphs: the next picture takes the place of all that the gradients need.
    """

    def __init__(self, unet: UNet) -> None:
        """Record nothing yet."""
        self.unet, self.in_turn = unet, False
        self._graphs: OrderedDict[tuple, Run] = OrderedDict()
        self._calls: OrderedDict[tuple, int] = OrderedDict()

    def __call__(self, pyramid: Sequence[Float[Tensor, "batch channel _ _"]]) -> Float[Tensor, "batch 4 height width"]:
        """What the generator returns, with gradients if they are enabled."""
        if pyramid[0].device.type != "cuda" or not torch.backends.cuda.is_built() or is_traced(pyramid[0]):
            return self.unet(pyramid)
        if torch.is_grad_enabled() and not self.in_turn:
            return self.unet(pyramid)
        key = self._key(pyramid)
        if key in self._graphs:
            self._graphs.move_to_end(key)
            return self._graphs[key](*pyramid)
        self._calls[key] = self._calls.pop(key, 0) + 1
        while len(self._calls) > 16:
            self._calls.popitem(last=False)
        if self._calls[key] < OFTEN:
            return self.unet(pyramid)
        while len(self._graphs) >= MOST:
            self._graphs.popitem(last=False)
        record = _with_gradients if torch.is_grad_enabled() else _without_gradients
        self._graphs[key] = record(self.unet, pyramid)
        return self._graphs[key](*pyramid)

    def _key(self, pyramid: Sequence[Tensor]) -> tuple:
        """All that a graph takes for granted."""
        weights = tuple((each.data_ptr(), each.requires_grad) for each in self.unet.parameters())
        maps = tuple((each.shape, each.stride(), each.dtype, each.requires_grad) for each in pyramid)
        return torch.is_grad_enabled(), torch.is_autocast_enabled("cuda"), maps, weights


class _Spread(nn.Module):
    """The generator with the maps as separate arguments, whose forward pass torch may replace."""

    def __init__(self, unet: UNet) -> None:
        super().__init__()
        self.unet = unet

    def forward(self, *pyramid: Tensor) -> Tensor:
        return self.unet(pyramid)


def _with_gradients(unet: UNet, pyramid: Sequence[Tensor]) -> Run:
    """A graph of the forward pass and one of the backward pass."""
    sample = tuple(each.detach().clone().requires_grad_(each.requires_grad) for each in pyramid)
    return torch.cuda.make_graphed_callables(_Spread(unet), sample, allow_unused_input=True)


def _without_gradients(unet: UNet, pyramid: Sequence[Tensor]) -> Run:
    """A graph of the forward pass."""
    fixed = [each.clone() for each in pyramid]
    stream = torch.cuda.Stream()
    stream.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(stream):
        unet(fixed)
    torch.cuda.current_stream().wait_stream(stream)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        drawn = unet(fixed)

    def run(*maps: Tensor) -> Tensor:
        for place, each in zip(fixed, maps, strict=True):
            place.copy_(each)
        graph.replay()
        return drawn.clone()

    return run
