"""The Gaussian blur of pictures."""

import pytest
import torch

from neural_strands.raster.gaussian_blur import gaussian_blur


def test_blur_keeps_constants_and_the_sum():
    spot = torch.zeros(31, 31)
    spot[15, 15] = 1.0
    assert gaussian_blur(spot, 2.0).sum() == pytest.approx(1.0, abs=1e-5)
    assert torch.allclose(gaussian_blur(torch.ones(8, 9), 1.5), torch.ones(8, 9))
