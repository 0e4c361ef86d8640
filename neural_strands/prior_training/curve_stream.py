"""Endless batches of training curves that depend only on the seed and the step, so that a resumed run repeats them."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.prior.curves import CurveConfig, augment, synthetic_curves

CHUNK = 2048
"""Number of curves drawn together."""
PART = 512
"""Number of curves built together, to bound memory."""
KEPT = 8
"""Number of chunks from which batches are drawn; a new one replaces the oldest."""


@dataclass(frozen=True)
class CurveStream:
    """Batches of synthetic curves, with some of the user's own strands among them.

    Attributes:
        seed: seed of all random numbers.
        config: distribution of the curves.
        own: further strands (local metres), augmented at each use.
        own_share: share of each chunk that comes from `own`.
        steps_a_chunk: steps after which a new chunk replaces the oldest.
        prepare: function whose result is computed once per chunk and cached with it.
    """

    seed: int
    config: CurveConfig
    own: Float[Tensor, "strand point 3"] | None
    own_share: float
    steps_a_chunk: int
    prepare: Callable[[Tensor], Tensor]

    def __post_init__(self) -> None:
        object.__setattr__(self, "_chunks", OrderedDict())

    def draw(self, count: int, *key: int) -> Float[Tensor, "{count} point 3"]:
        """Draw curves that depend only on the seed and `key`."""
        generator = keyed_generator(self.seed, *key)
        parts = [min(PART, count - start) for start in range(0, count, PART)]
        curves = torch.cat([synthetic_curves(part, generator, self.config) for part in parts])
        if self.own is not None and len(self.own):
            chosen = int(count * self.own_share)
            index = torch.randint(len(self.own), (chosen,), generator=generator)
            curves[:chosen] = augment(self.own[index], generator)
        return curves

    def batch(self, step: int, size: int) -> tuple[Float[Tensor, "{size} point 3"], Tensor]:
        """A batch for this step, and the result of `prepare` for it."""
        newest = step // self.steps_a_chunk
        chunks = [self._chunk(index) for index in range(max(0, newest - KEPT + 1), newest + 1)]
        generator = keyed_generator(self.seed, 1, step)
        index = torch.randint(len(chunks) * CHUNK, (size,), generator=generator)
        curves = torch.stack([chunks[i // CHUNK][0][i % CHUNK] for i in index.tolist()])
        prepared = torch.stack([chunks[i // CHUNK][1][i % CHUNK] for i in index.tolist()])
        return curves, prepared

    def _chunk(self, index: int) -> tuple[Tensor, Tensor]:
        kept: OrderedDict[int, tuple[Tensor, Tensor]] = self.__dict__["_chunks"]
        if index not in kept:
            curves = self.draw(CHUNK, 0, index)
            kept[index] = curves, self.prepare(curves)
            while len(kept) > KEPT:
                kept.popitem(last=False)
        return kept[index]


def keyed_generator(seed: int, *key: int) -> torch.Generator:
    """A generator for each seed and key."""
    mixed = seed
    for number in key:
        mixed = (mixed * 6364136223846793005 + number + 1442695040888963407) % 2**63
    return torch.Generator().manual_seed(mixed)
