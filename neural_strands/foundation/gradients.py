"""Gradients and steps along them, without parts of torch that take seconds to import and are of no use here."""

from inspect import unwrap

import torch
from torch import Tensor


class Adam(torch.optim.Adam):
    """`torch.optim.Adam`, step for step, without torch's compiler.

    Its methods are wrapped in functions that import the compiler in order to tell it to leave them alone. Here they are
    without the wrapping. Nothing is compiled during a step, so that there is nobody to tell.
    """

    add_param_group = unwrap(torch.optim.Adam.add_param_group)
    zero_grad = unwrap(torch.optim.Adam.zero_grad)
    state_dict = unwrap(torch.optim.Adam.state_dict)
    load_state_dict = unwrap(torch.optim.Adam.load_state_dict)
    step = torch.no_grad()(unwrap(torch.optim.Adam.step))


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
