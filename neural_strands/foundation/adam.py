"""torch's Adam without torch's compiler, whose import takes seconds of every process that optimises."""

from inspect import unwrap

import torch


class Adam(torch.optim.Adam):
    """`torch.optim.Adam`, step for step.

    Its methods are wrapped in functions that import the compiler in order to tell it to leave them alone. Here they are
    without the wrapping. Nothing is compiled during a step, so that there is nobody to tell.
    """

    add_param_group = unwrap(torch.optim.Adam.add_param_group)
    zero_grad = unwrap(torch.optim.Adam.zero_grad)
    state_dict = unwrap(torch.optim.Adam.state_dict)
    load_state_dict = unwrap(torch.optim.Adam.load_state_dict)
    step = torch.no_grad()(unwrap(torch.optim.Adam.step))
