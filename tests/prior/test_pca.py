"""The baseline against an SVD."""

import pytest
import torch

from neural_strands.geometry.strands import lengths
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.pca import StrandPca


def test_it_is_the_truncated_svd_of_shapes_of_unit_length() -> None:
    curves = synthetic_curves(400, torch.Generator().manual_seed(0)).double()
    pca = StrandPca.fit(curves, 16)
    shapes = (curves / lengths(curves)[:, None, None]).flatten(1)
    u, s, v = torch.linalg.svd(shapes - shapes.mean(dim=0), full_matrices=False)
    expected = shapes.mean(dim=0) + (u[:, :15] * s[:15]) @ v[:15]
    decoded = pca.decode(pca.encode(curves)) / lengths(curves)[:, None, None]
    torch.testing.assert_close(decoded.flatten(1), expected, atol=1e-6, rtol=0)
    assert pca.encode(curves).shape == (400, 16)


def test_too_few_curves_are_refused() -> None:
    with pytest.raises(ValueError, match="63 components need"):
        StrandPca.fit(synthetic_curves(10, torch.Generator().manual_seed(0)))
