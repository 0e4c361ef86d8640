"""The heading's flat coordinates: inverse, middle, and bounds."""

import pytest
import torch

from neural_strands.prior.heading import FARTHEST, heading_from_smooth, smooth_from_heading

REACH = torch.tensor([0.5, -0.2, 0.1], dtype=torch.float64)


def test_one_undoes_the_other(generator: torch.Generator) -> None:
    smooth = torch.randn(200, 3, 3, generator=generator, dtype=torch.float64)
    # Ends within reach.
    end = smooth @ REACH
    smooth = smooth * (0.9 * torch.rand(200, 1, generator=generator) / end.norm(dim=1, keepdim=True))[..., None]
    northern = (smooth @ REACH)[:, 2] > -0.9 * (smooth @ REACH).norm(dim=1)
    coded = heading_from_smooth(smooth[northern], REACH)
    torch.testing.assert_close(smooth_from_heading(coded, REACH), smooth[northern])


@pytest.mark.parametrize(
    ("heading", "expected"),
    [
        # Zero: along the normal, half the farthest distance.
        ((0.0, 0.0, 0.0), (0.0, 0.0, FARTHEST / 2)),
        # The unit circle is the tangent plane.
        ((1.0, 0.0, 0.0), (FARTHEST / 2, 0.0, 0.0)),
        ((0.0, -1.0, 0.0), (0.0, -FARTHEST / 2, 0.0)),
    ],
)
def test_where_headings_point(heading: tuple[float, ...], expected: tuple[float, ...]) -> None:
    coded = torch.zeros(1, 3, 3, dtype=torch.float64)
    coded[0, :, 0] = torch.tensor(heading)
    coded[0, :, 1:] = 0.3
    end = smooth_from_heading(coded, REACH) @ REACH
    torch.testing.assert_close(end[0], torch.tensor(expected, dtype=torch.float64))


def test_headings_out_of_bounds_stay_finite_and_near() -> None:
    smooth = torch.zeros(3, 3, 3, dtype=torch.float64)
    # Straight into the scalp, farther than can be, and nowhere.
    smooth[0, 2, 0], smooth[1, 0, 0] = -1.8, 2.4
    coded = heading_from_smooth(smooth, REACH)
    assert torch.isfinite(coded).all()
    gap = (smooth_from_heading(coded, REACH) @ REACH - smooth @ REACH).norm(dim=1)
    assert gap[0] < 0.1
    assert gap[1] < 0.16
    assert gap[2] < 1e-3
