"""Where it matters, CUDA computes with the precision of the CPU."""

from contextlib import nullcontext

import pytest
import torch

from neural_strands.evaluation.image_metrics import ssim
from neural_strands.foundation.precision import exact_convolutions


def allowed() -> bool:
    return torch.backends.cudnn.allow_tf32


@pytest.mark.parametrize("before", [True, False])
def test_the_setting_holds_inside_and_comes_back(before: bool, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", before)
    with exact_convolutions():
        assert not allowed()
    assert allowed() == before


def rounded(values: torch.Tensor) -> torch.Tensor:
    """To TF32: ten bits after the leading one."""
    bits = values.contiguous().view(torch.int32)
    return ((bits + 0x1000) & ~0x1FFF).view(torch.float32)


def test_ssim_does_not_survive_tf32_and_so_does_not_use_it(generator: torch.Generator, monkeypatch: pytest.MonkeyPatch):
    reference = 0.5 + 0.01 * torch.rand(40, 40, 3, generator=generator)
    image = reference + 0.005 * torch.randn(40, 40, 3, generator=generator)
    exact, convolve = float(ssim(image, reference)), torch.nn.functional.conv2d

    def as_cudnn_does(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        return convolve(rounded(values), rounded(weight)) if allowed() else convolve(values, weight)

    monkeypatch.setattr(torch.nn.functional, "conv2d", as_cudnn_does)
    assert float(ssim(image, reference)) == exact
    monkeypatch.setattr("neural_strands.evaluation.image_metrics.exact_convolutions", nullcontext)
    assert abs(float(ssim(image, reference)) - exact) > 1e-3
