"""Gradients with given weights, without sympy, which torch imports for them in half a second."""

import torch
from torch import Tensor


def weighted_gradient(values: Tensor, weights: Tensor, of: Tensor, retain_graph: bool = False) -> Tensor:
    """The gradient of the weighted sum of values, the transpose of a linear map if values are linear.

    Args:
        values: depend on `of`.
        weights: factors of the values, same shape.
        of: tensor with respect to which the gradient is taken.
        retain_graph: whether `values` is differentiated again.
    """
    # The bits are those of torch.autograd.grad(values, of, weights), which imports sympy to compare the shapes.
    return torch.autograd.grad((values * weights).sum(), of, retain_graph=retain_graph)[0]
