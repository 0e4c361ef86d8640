"""Filters against scipy's design and their own frequency response."""

import math

import numpy as np
import pytest
import scipy.signal
import torch

from neural_strands.raster.filters import LowPass, kaiser_attenuation, kaiser_lowpass, kaiser_shape


@pytest.mark.parametrize(("taps", "cutoff", "transition"), [(12, 0.25, 0.15), (8, 0.2, 0.3), (24, 0.1, 0.05)])
def test_the_design_is_that_of_scipy(taps, cutoff, transition):
    expected = scipy.signal.firwin(taps, cutoff, width=transition, fs=1.0)
    np.testing.assert_allclose(kaiser_lowpass(taps, cutoff, transition).numpy(), expected, rtol=1e-5, atol=1e-7)


def test_window_formulas_are_those_of_scipy():
    attenuation = kaiser_attenuation(12, 0.15)
    assert attenuation == pytest.approx(scipy.signal.kaiser_atten(12, 0.3))
    for value in (10.0, attenuation, 70.0):
        assert kaiser_shape(value) == pytest.approx(scipy.signal.kaiser_beta(value))


def test_passes_constants_and_halves_at_the_cutoff():
    low_pass = LowPass()
    coefficients, frequency = low_pass.coefficients(), torch.tensor([0.0, 0.5 * low_pass.cutoff, 0.35, 0.4, 0.45, 0.5])
    # The amplitude of a symmetric filter, at frequencies in cycles per sample.
    position = torch.arange(len(coefficients)) - (len(coefficients) - 1) / 2
    response = torch.cos(2 * math.pi * frequency[:, None] * position) @ coefficients
    assert response[0].item() == pytest.approx(1.0, abs=1e-6)
    assert response[1].item() == pytest.approx(0.5, abs=0.05)
    assert response[2:].abs().max() < 10 ** (-30 / 20)  # stop band of the default: 30 dB down


@pytest.mark.parametrize("fault", [{"taps": 5}, {"taps": 0}, {"cutoff": 0.0}, {"transition": -1.0}, {"factor": 0}])
def test_refuses_filters_that_cannot_be(fault):
    with pytest.raises(ValueError, match="low-pass filter"):
        LowPass(**fault)
