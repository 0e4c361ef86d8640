"""Gradients and steps have the bits of torch's. `whole_line.py` checks that they import nothing that takes seconds."""

import pytest
import torch

from neural_strands.foundation.gradients import Adam, weighted_gradient

GROUPS = 2


def optimised(kind: type[torch.optim.Adam], fused: bool | None, resumed_at: int | None) -> list[torch.Tensor]:
    """Parameters after twelve steps of a falling rate; a second optimiser may take over halfway."""
    random = torch.Generator().manual_seed(0)
    parameters = [torch.randn(7, generator=random).requires_grad_() for _ in range(GROUPS)]

    def fresh() -> torch.optim.Adam:
        groups = [{"params": [value], "lr": 0.1 / (k + 1), "rate": 1.0} for k, value in enumerate(parameters)]
        return kind(groups, betas=(0.9, 0.99), eps=1e-12, fused=fused)

    optimiser = fresh()
    for step in range(12):
        if step == resumed_at:
            state, optimiser = optimiser.state_dict(), fresh()
            optimiser.load_state_dict(state)
        for group in optimiser.param_groups:
            group["lr"] *= 0.9
        optimiser.zero_grad(set_to_none=True)
        assert all(value.grad is None for value in parameters)
        torch.stack(parameters[: 1 + step % GROUPS]).square().sub(1).square().sum().backward()
        optimiser.step()
    return [value.detach() for value in parameters]


@pytest.mark.parametrize("fused", [True, None])
@pytest.mark.parametrize("resumed_at", [None, 5])
def test_steps_are_those_of_torch(fused: bool | None, resumed_at: int | None):
    for ours, theirs in zip(optimised(Adam, fused, resumed_at), optimised(torch.optim.Adam, fused, None), strict=True):
        assert torch.equal(ours, theirs)


def test_a_schedule_changes_the_rate_and_hooks_are_called():
    value, called = torch.ones(3, requires_grad=True), []
    optimiser = Adam([value], lr=0.5)
    optimiser.register_step_post_hook(lambda *_: called.append(True))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, 2)
    for _ in range(2):
        value.sum().backward()
        optimiser.step()
        schedule.step()
    assert called == [True, True]
    assert optimiser.param_groups[0]["lr"] == pytest.approx(0, abs=1e-9)


def test_bits_of_a_weighted_gradient_are_those_of_given_gradients(generator: torch.Generator):
    place = torch.randint(0, 50, (400,), generator=generator)
    of = torch.randn(50, 3, generator=generator).requires_grad_()
    weights = torch.randn(400, 3, generator=generator)
    values = of.sin()[place] * torch.randn(400, 1, generator=generator)
    (expected,) = torch.autograd.grad(values, of, weights, retain_graph=True)
    for _ in range(2):
        assert torch.equal(weighted_gradient(values, weights, of, retain_graph=True), expected)
