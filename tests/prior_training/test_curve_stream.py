"""Batches depend on seed and step alone."""

import torch

from neural_strands.geometry.strands import lengths
from neural_strands.prior.curves import CurveConfig
from neural_strands.prior_training import curve_stream
from neural_strands.prior_training.curve_stream import CurveStream, keyed_generator


def stream(own: torch.Tensor | None = None) -> CurveStream:
    return CurveStream(3, CurveConfig(), own, 0.5, 2, lengths)


def test_a_batch_can_be_drawn_again_out_of_order(monkeypatch) -> None:
    monkeypatch.setattr(curve_stream, "CHUNK", 64)
    monkeypatch.setattr(curve_stream, "KEPT", 2)
    first = stream()
    batches = [first.batch(step, 16) for step in range(8)]
    second = stream()
    curves, prepared = second.batch(7, 16)
    assert torch.equal(curves, batches[7][0])
    assert torch.equal(prepared, lengths(curves))
    assert not torch.equal(batches[6][0], batches[7][0])


def test_own_strands_are_among_the_curves_augmented() -> None:
    own = torch.linspace(0, 0.33, 100)[:, None].expand(1, 100, 1) * torch.tensor([0.0, 0.0, 1.0])
    curves = stream(own).draw(10, 0)
    straight = (curves[:, -1] - curves[:, 0]).norm(dim=-1) / lengths(curves) > 0.99999
    assert straight[:5].all()
    assert lengths(curves)[:5].std() > 0


def test_keys_give_different_generators() -> None:
    keys = ((0,), (0, 0), (0, 1), (1, 0), (0, 0, 1), (0, 1, 0))
    draws = {float(torch.rand(1, generator=keyed_generator(*key))) for key in keys}
    assert len(draws) == 6
