import threading
import time

import pytest
import torch

from neural_strands.editing.settings import Haircut, Wind
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands, lengths
from neural_strands.runs.newest_model import newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.open_scene import open_run
from neural_strands.viewer.page import Page
from neural_strands.viewer.wind_player import WindPlayer, thinned


class FakePage(Page):
    """A page that remembers the moments it was shown."""

    def __init__(self, scene):
        self.scene, self.moments = scene, []

    def show_moment(self, moment):
        self.moments.append(moment)


@pytest.fixture(scope="module")
def scene(tiny_run):
    return open_run(tiny_run, newest_state(RunFolder(tiny_run)), torch.device("cpu"))


def wait_for(page, count):
    end = time.monotonic() + 60
    while len(page.moments) < count and time.monotonic() < end:
        time.sleep(0.01)


def test_hair_moves_until_it_is_stopped_and_then_rests(scene):
    page, ends = FakePage(scene.with_edits((Wind(strength=3.0),))), []
    player = WindPlayer(page, lambda: ends.append(True))
    player.play()
    wait_for(page, 4)
    player.stop()
    assert page.moments[-1] is None
    assert ends == [True]
    first, later = page.moments[0].strands.points, page.moments[3].strands.points
    torch.testing.assert_close(first[:, 0], later[:, 0])
    assert float((first - later).norm(dim=-1).max()) > 1e-4


def test_hair_that_is_cut_blows_on(scene):
    page, ends = FakePage(scene.with_edits((Wind(),))), []
    player = WindPlayer(page, lambda: ends.append(True))
    player.play()
    wait_for(page, 1)
    page.scene = scene.with_edits((Wind(), Haircut(fraction=0.5)))
    wait_for(page, len(page.moments) + 2)
    moment = page.moments[-1]
    assert ends == []
    player.stop()
    whole, cut = (lengths(each.strands.points).mean() for each in (page.moments[0], moment))
    assert float(cut) < 0.6 * float(whole)


def test_the_wind_ends_when_it_is_undone(scene):
    page, ended = FakePage(scene.with_edits((Wind(),))), threading.Event()
    player = WindPlayer(page, ended.set)
    player.play()
    wait_for(page, 1)
    page.scene = scene
    assert ended.wait(60)
    assert page.moments[-1] is None
    # The callback at the end may stop the player from its own thread.
    player.stop()


def test_without_wind_among_the_edits_there_is_one_sentence(scene):
    with pytest.raises(InputError, match="add it first"):
        WindPlayer(FakePage(scene), lambda: None).play()


def test_thinned_strands_keep_their_ends_and_their_place_on_the_fitted_strand():
    points = torch.rand(5, 100, 3)
    thin = thinned(Strands(points, width=torch.rand(5, 100)), 34)
    assert thin.points.shape == (5, 34, 3)
    assert thin.width.shape == (5, 34)
    torch.testing.assert_close(thin.points[:, [0, -1]], points[:, [0, -1]])
    torch.testing.assert_close(thin.t[0, [0, -1]], torch.tensor([0.0, 1.0]))
    assert thinned(Strands(points[:, :20])).points_per_strand == 20
