import numpy as np
import pytest
import torch

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands
from neural_strands.viewer.line_colours import COLOURINGS, segment_lines, strand_lines


def strands(count=30, points=12):
    random = torch.Generator().manual_seed(1)
    return Strands(torch.rand(count, points, 3, generator=random), root_uv=torch.rand(count, 2, generator=random))


@pytest.mark.parametrize("colouring", COLOURINGS)
def test_pieces_of_a_strand_are_joined_from_root_to_tip(colouring):
    given = strands()
    ends, colours = strand_lines(given, colouring)
    assert ends.shape == colours.shape == (30 * 11, 2, 3)
    joined = ends.reshape(30, 11, 2, 3)
    np.testing.assert_array_equal(joined[:, 1:, 0], joined[:, :-1, 1])
    np.testing.assert_array_equal(joined[:, 0, 0], given.points[:, 0].numpy())
    np.testing.assert_array_equal(joined[:, -1, 1], given.points[:, -1].numpy())


def test_there_are_never_more_pieces_than_allowed():
    ends, _ = strand_lines(strands(1000, 100), "direction", most=2000)
    assert 1000 < len(ends) <= 2000


def test_a_strands_colour_is_its_own_in_linear_light():
    given = Strands(torch.rand(4, 5, 3), color=torch.full((4, 3), 0.2144))
    _, colours = strand_lines(given, "hair colour")
    assert (colours == round(0.2144 * 255)).all()


def test_the_direction_shows_as_its_components():
    # A component of 0 shows as sRGB 0.5, which is linear 0.214 (IEC 61966-2-1).
    up = torch.zeros(1, 2, 3)
    up[0, 1, 1] = 1.0
    _, colours = strand_lines(Strands(up), "direction")
    np.testing.assert_array_equal(colours, np.broadcast_to([55, 255, 55], (1, 2, 3)))


def test_strands_that_no_photograph_saw_have_a_colour_of_their_own():
    given = Strands(torch.rand(4, 2, 3), unseen=torch.tensor([0.0, 0.4, 0.6, float("nan")]))
    _, colours = strand_lines(given, "seen or guessed")
    first = colours[:, 0].tolist()
    assert first[0] == first[1] == first[3] != first[2]
    _, plain = strand_lines(Strands(given.points), "seen or guessed")
    assert plain[:, 0].tolist() == [first[0]] * 4


def test_points_that_are_not_finite_are_left_out():
    given = strands(3, 4)
    given.points[1, 2] = float("nan")
    ends, _ = strand_lines(given, "root position")
    assert len(ends) == 9 - 2
    assert np.isfinite(ends).all()


def test_segments_are_thinned_as_wholes():
    points = torch.rand(100, 3)
    segments = LineSegments(
        points, torch.nn.functional.normalize(points, dim=1), torch.ones(100), torch.arange(100) // 10
    )
    ends, colours = segment_lines(segments)
    assert ends.shape == colours.shape == (90, 2, 3)
    few, _ = segment_lines(segments, most=50)
    assert len(few) == 45
