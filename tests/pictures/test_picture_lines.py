"""Strands and segments as pictures: their colours, and what the head hides."""

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.pictures.lines import (
    DIMMED,
    PAPER,
    lines_over_photograph,
    lines_picture,
    segments_over_photograph,
)

UPRIGHT = torch.tensor([[[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]])


@pytest.fixture
def camera() -> Camera:
    return Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 100.0, (32, 32))


def wall(z: float) -> Mesh:
    """A square across the view."""
    corners = torch.tensor([[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]])
    return Mesh(corners, torch.tensor([[0, 1, 2], [0, 2, 3]]))


def test_strands_are_coloured_by_direction_and_hidden_by_the_head(camera):
    picture = lines_picture(UPRIGHT, camera)
    column = picture[16, :, :]
    inked = (column - PAPER).abs().sum(dim=-1) > 0.05
    assert 1 <= int(inked.sum()) <= 2
    # A pixel half covered: the mean of white and of 0.5 + 0.5 * (0, 1, 0).
    assert column[inked][0, 1] > column[inked][0, 0]
    hidden = lines_picture(UPRIGHT, camera, wall(0.1))
    assert float(hidden.reshape(-1, 3).std(dim=0).max()) < 1e-6
    assert (lines_picture(UPRIGHT[:0], camera) == PAPER).all()


def test_colours_of_points_are_blended_along_a_strand(camera):
    """A strand from blue at the bottom to red at the top: at a height, the share of red is that of the way up."""
    strand = torch.tensor([[[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]])
    colours = torch.tensor([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]])
    picture = lines_picture(strand, camera, colours=colours)
    inked = (picture - PAPER).abs().sum(dim=-1) > 0.05
    rows, columns = torch.nonzero(inked, as_tuple=True)
    # Ten pixels are 0.1 m, seen from 1 m; a pixel that the line covers by half is half white, but has no green.
    covered = 1 - picture[rows, columns, 1]
    red = (picture[rows, columns, 0] - (1 - covered)) / covered
    height = (16 - (rows + 0.5)) / 100
    torch.testing.assert_close(red, ((height + 0.1) / 0.2).clamp(0, 1), atol=0.03, rtol=0)
    assert len(rows) >= 18


def test_the_photograph_is_kept_where_no_strand_covers_it(camera):
    photograph = torch.full((32, 32, 3), 0.25)
    laid = lines_over_photograph(photograph, UPRIGHT, camera, wall(-0.5))
    changed = (laid != photograph).any(dim=-1)
    assert 1 <= int(changed[16].sum()) <= 2
    assert not changed[:, :12].any()


def test_segments_lie_over_a_dimmed_photograph_and_not_behind_the_head_or_nearer_segments(camera):
    points = torch.cat([UPRIGHT[0], UPRIGHT[0] + torch.tensor([0.005, 0.0, -0.2])])
    along = torch.tensor([[0.0, 1.0, 0.0]]).expand(4, 3)
    segments = LineSegments(points, along, torch.ones(4), torch.tensor([0, 0, 1, 1]))
    photograph = torch.ones(32, 32, 3)

    def inked(head: Mesh | None, shown: LineSegments = segments) -> torch.Tensor:
        drawn = segments_over_photograph(photograph, shown, camera, head)
        assert float(drawn[0, 0, 0]) == pytest.approx(DIMMED / 255)
        return (drawn[..., 1] - DIMMED / 255) > 0.1

    front = segments.select(torch.tensor([0, 1]))
    assert inked(None).any()
    # The farther segment shares the nearer one's blocks: it adds nothing.
    torch.testing.assert_close(inked(None), inked(None, front))
    assert not inked(wall(0.1)).any()
    # Half a percent of its depth behind the surface still shows.
    torch.testing.assert_close(inked(wall(0.005)), inked(None))
