"""Robust weights for reweighted least squares: residuals far beyond their expected size count for nothing."""

from typing import TypeVar

import numpy as np
from torch import Tensor

Squares = TypeVar("Squares", np.ndarray, Tensor)


def geman_mcclure(squared: Squares) -> Squares:
    """Weights of residuals by the estimator of Geman and McClure: 1 for none, 1/4 at the expected size.

    Args:
        squared: squared residuals in units of their expected size.
    """
    return (1.0 + squared) ** -2
