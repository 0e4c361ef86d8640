"""Procedural grooms: outside the head, rooted on the scalp, of the lengths asked for, the same for the same seed."""

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.geometry.strands import lengths, segments
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis.groom import make_groom
from neural_strands.synthesis.styles import MELANIN, STYLES, StyleName

COUNT = 400


def _groom(style: StyleName, seed: int = 0, count: int = COUNT):
    return make_groom(mannequin(), STYLES[style], MELANIN["brown"], count, torch.Generator().manual_seed(seed))


@pytest.fixture(scope="module", params=list(STYLES))
def styled(request):
    return request.param, _groom(request.param)


def test_no_strand_enters_the_head(styled):
    _, groom = styled
    middles = (groom.points[:, 1:] + groom.points[:, :-1]) / 2
    for points in (groom.points[:, 1:], middles):
        distance = signed_distance(points.reshape(-1, 3), mannequin().mesh).distance
        assert float(distance.min()) > 0.0


def test_roots_lie_on_the_scalp(styled):
    _, groom = styled
    assert closest_points(groom.points[:, 0], mannequin().scalp_mesh).distance.max() < 1e-5
    assert groom.root_uv is not None
    assert ((groom.root_uv >= 0) & (groom.root_uv <= 1)).all()


def test_strands_are_smooth_and_have_a_plausible_length(styled):
    style, groom = styled
    step = segments(groom.points).norm(dim=-1)
    # A coil adds the length of its turns to that of its axis: sqrt(1 + (2 pi A / L)^2) times at most 1.5.
    assert lengths(groom.points).median() > 0.3 * STYLES[style].length
    assert lengths(groom.points).max() < 3.5 * STYLES[style].length
    assert step.max() < 0.03
    assert torch.isfinite(groom.points).all()


def test_the_seed_decides_the_groom():
    first = _groom("wavy", 3, 100).points
    assert torch.equal(first, _groom("wavy", 3, 100).points)
    assert not torch.equal(first, _groom("wavy", 4, 100).points)


def test_a_parting_sends_hair_to_both_sides():
    groom = _groom("straight")
    root, tip = groom.points[:, 0], groom.points[:, 40]
    parting = STYLES["straight"].parting
    assert parting is not None
    side = root[:, 0] - parting
    front_and_top = (root[:, 2] > 0.0) & (root[:, 1] > 0.05) & (side.abs() > 0.01)
    moved = (tip[:, 0] - root[:, 0]) * side.sign()
    assert int(front_and_top.sum()) > 20
    assert (moved[front_and_top] > 0).float().mean() > 0.95


def test_strands_vary_in_width_and_colour_and_taper():
    groom = _groom("wavy")
    assert groom.width is not None
    assert groom.color is not None
    assert (groom.width[:, 0] > groom.width[:, -1]).all()
    assert (groom.color.std(dim=0) > 0.1 * groom.color.mean(dim=0)).all()
    # Brown hair: more red than green than blue.
    assert (groom.color.mean(dim=0).diff() < 0).all()


def test_a_count_out_of_range_is_refused():
    with pytest.raises(InputError, match="expected 100 to"):
        _groom("wavy", count=3)


@pytest.mark.slow
def test_ten_thousand_curls_stay_outside():
    groom = _groom("curly", count=10_000)
    assert float(signed_distance(groom.points[:, 1:].reshape(-1, 3), mannequin().mesh).distance.min()) > 0.0
