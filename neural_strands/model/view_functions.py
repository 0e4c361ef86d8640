"""Functions of a camera's direction, with which the colours of strands change from view to view.

They are the real spherical harmonics of degree 1 and 2, which radiance fields use too (Plenoxels, Gaussian splatting),
here made uncorrelated over the photographs. Cameras that saw only the face hardly differ in some harmonics, and a
strand's change with these would be guessed. Each function has mean 0 over the photographs, and variance 1 unless they
hardly differ in it.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

COUNT = 8
"""Number of functions."""
LEAST_DEVIATION = 0.02
"""Combinations of harmonics whose standard deviation over the photographs is below this are not scaled up to 1."""
AROUND = math.radians(10)
"""Standard deviation of the weights of photographs around the nearest."""
LIMIT = 2.5
"""Largest absolute value: beyond what the photographs show, colours stop changing."""


def view_functions(
    direction: Float[Tensor, "view 3"], seen: Float[Tensor, "photograph 3"], elsewhere: float = 0.0
) -> Float[Tensor, "view function"]:
    """Evaluate the functions.

    Args:
        direction: unit directions from the hair to the cameras.
        seen: unit directions to the cameras of the photographs; without any, all functions are zero.
        elsewhere: how far the cameras are from all photographs, from 0 to 1 (`seen_directions.share_elsewhere`). There,
            polynomials would extrapolate, and the functions have the values of the photographs around the nearest.
    """
    if len(seen) == 0:
        return direction.new_zeros(len(direction), COUNT)
    mean, axes = view_basis(seen)
    functions = in_basis(direction.double(), mean, axes)
    if elsewhere > 0:
        weights = torch.softmax((direction @ seen.T).double() / AROUND**2, dim=1)
        functions = torch.lerp(functions, weights @ in_basis(seen.double(), mean, axes), elsewhere)
    return functions.to(direction)


def view_basis(
    seen: Float[Tensor, "photograph 3"],
) -> tuple[Float[Tensor, " harmonic"], Float[Tensor, "harmonic function"]]:
    """Mean of the harmonics over at least one photograph, and the matrix that makes them uncorrelated, in float64.

    The matrix is symmetric: unlike the axes of the covariance, it does not depend on their signs and order.
    """
    harmonics = _harmonics(seen.double())
    mean = harmonics.mean(dim=0)
    variance, axes = torch.linalg.eigh((harmonics - mean).T @ (harmonics - mean) / len(seen))
    whiten = (axes / variance.clamp(min=LEAST_DEVIATION**2).sqrt()) @ axes.T
    return mean, whiten


def in_basis(
    direction: Float[Tensor, "view 3"], mean: Float[Tensor, " harmonic"], axes: Float[Tensor, "harmonic function"]
) -> Float[Tensor, "view function"]:
    """The functions of unit directions, given what `view_basis` returned."""
    return ((_harmonics(direction) - mean) @ axes).clamp(-LIMIT, LIMIT)


def _harmonics(direction: Float[Tensor, "view 3"]) -> Float[Tensor, "view function"]:
    """Real spherical harmonics of degree 1 and 2, scaled to variance 1 over the sphere."""
    x, y, z = functional.normalize(direction, dim=1).unbind(dim=1)
    first, second = 3**0.5, 15**0.5
    linear = [first * x, first * y, first * z]
    quadratic = [second * x * y, second * y * z, second * z * x, second / 2 * (x * x - y * y)]
    return torch.stack([*linear, *quadratic, 5**0.5 / 2 * (3 * z * z - 1)], dim=1)
