"""Weighted gradients: the bits of torch's own. `whole_line.py` checks that they do not import sympy."""

import torch

from neural_strands.foundation.gradients import weighted_gradient


def test_bits_are_those_of_given_gradients(generator: torch.Generator):
    place = torch.randint(0, 50, (400,), generator=generator)
    of = torch.randn(50, 3, generator=generator).requires_grad_()
    weights = torch.randn(400, 3, generator=generator)
    values = of.sin()[place] * torch.randn(400, 1, generator=generator)
    (expected,) = torch.autograd.grad(values, of, weights, retain_graph=True)
    for _ in range(2):
        assert torch.equal(weighted_gradient(values, weights, of, retain_graph=True), expected)
