"""A baseline: principal component analysis with as many numbers per strand as the prior's latent."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import lengths


@dataclass(frozen=True)
class StrandPca:
    """PCA of strands divided by their length; the length is stored as one of the numbers.

    Dividing by the length halves the error on short hair, compared with a PCA of the points in metres.

    Attributes:
        mean: mean strand of unit length, flattened.
        components: principal components, orthonormal rows.
    """

    mean: Float[Tensor, " coordinate"]
    components: Float[Tensor, "component coordinate"]

    @classmethod
    def fit(cls, curves: Float[Tensor, "strand point 3"], size: int = 64) -> "StrandPca":
        """Fit `size - 1` components (the length is the last number) to curves in local metres.

        Raises:
            ValueError: fewer curves or coordinates than components.
        """
        flat = (curves / lengths(curves)[:, None, None]).flatten(1).double()
        if min(flat.shape) < size - 1:
            raise ValueError(f"{size - 1} components need at least as many curves and coordinates, found {flat.shape}")
        mean = flat.mean(dim=0)
        _, vectors = torch.linalg.eigh((flat - mean).T @ (flat - mean))
        return cls(mean.to(curves), vectors.flip(1)[:, : size - 1].T.to(curves))

    def encode(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand number"]:
        """Components of each strand's shape, then its length."""
        length = lengths(points)
        flat = (points / length[:, None, None]).flatten(1)
        return torch.cat([(flat - self.mean) @ self.components.T, length[:, None]], dim=1)

    def decode(self, numbers: Float[Tensor, "strand number"]) -> Float[Tensor, "strand point 3"]:
        """Decode numbers to strands in local metres."""
        shape = self.mean + numbers[:, :-1] @ self.components
        return (shape * numbers[:, -1:]).unflatten(1, (-1, 3))
