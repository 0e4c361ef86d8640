"""Tests for robust weights."""

import numpy as np
import torch

from neural_strands.preparation.robust import geman_mcclure


def test_are_the_slope_of_the_estimator_over_the_residual() -> None:
    """The estimator is r² / (2 (1 + r²)); reweighted least squares weights residuals by its slope over r."""
    residual = torch.tensor([0.1, 0.5, 1.0, 3.0, 20.0], dtype=torch.float64, requires_grad=True)
    estimator = residual**2 / (2 * (1 + residual**2))
    (slope,) = torch.autograd.grad(estimator.sum(), residual)
    squared = residual.detach() ** 2
    assert torch.allclose(geman_mcclure(squared), slope / residual.detach(), rtol=1e-12)
    assert np.allclose(geman_mcclure(squared.numpy()), geman_mcclure(squared).numpy(), rtol=1e-15)
