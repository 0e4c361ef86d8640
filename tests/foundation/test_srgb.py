"""The sRGB curve: its definition, its inverse, and stored samples through it."""

import numpy as np
import pytest
import torch

from neural_strands.foundation.srgb import linear_samples, srgb_samples, to_linear, to_srgb


def test_the_curve_meets_its_definition():
    linear = torch.tensor([[0.0, 0.0031308, 0.5], [0.18, 1.0, 0.0]])
    expected = torch.tensor([[0.0, 0.04045, 0.735357], [0.461356, 1.0, 0.0]])
    torch.testing.assert_close(to_srgb(linear), expected, rtol=0, atol=1e-5)


def test_decoding_undoes_encoding_beyond_black_and_white_too():
    values = torch.linspace(-2, 4, 4001, dtype=torch.float64)
    torch.testing.assert_close(to_linear(to_srgb(values)), values, rtol=1e-7, atol=1e-7)
    assert (to_srgb(values).diff() > 0).all()


def test_gradients_are_those_of_the_curve():
    values = torch.tensor([-0.5, 0.0, 0.001, 0.01, 0.5, 1.5], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(to_srgb, values)
    assert torch.autograd.gradcheck(to_linear, values)


@pytest.mark.parametrize(("dtype", "error"), [(np.uint8, 0), (np.uint16, 7)])
def test_stored_samples_survive_the_way_to_linear_light_and_back(dtype, error):
    stored = np.arange(np.iinfo(dtype).max + 1).astype(dtype)
    again = srgb_samples(linear_samples(stored), stored.dtype)
    assert again.dtype == dtype
    assert np.abs(again.astype(int) - stored).max() <= error


def test_samples_are_decoded_by_the_curve():
    found = linear_samples(np.array([0, 128, 255], np.uint8)) / 65535
    np.testing.assert_allclose(found, to_linear(torch.tensor([0.0, 128 / 255, 1.0])), atol=1e-5)
