"""Which window the stereo of a fit uses, with the stereo itself replaced by the true segments."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from tiny_capture import combed_strands, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting import stereo as stereo_module
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.stereo import find_segments

CONFIG = FitConfig(strands=200)


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    folder = tmp_path_factory.mktemp("capture") / "ball"
    write_capture(folder)
    return Capture.load(folder)


@pytest.mark.parametrize(("grainy", "curly"), [(False, False), (True, False), (True, True)])
def test_only_straight_hair_in_noise_is_matched_again(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, grainy: bool, curly: bool
):
    used, found = [], true_segments(combed_strands(60))

    def matched(views, mesh, config, random, work, track):
        list(track([0], "orientation", 1))
        used.append((config.orientation.window, work))
        return found

    monkeypatch.setattr(stereo_module, "reconstruct", matched)
    monkeypatch.setattr(stereo_module, "noisy", lambda *_: grainy)
    if curly:
        monkeypatch.setattr(stereo_module, "find_course", lambda *_: SimpleNamespace(curls="curls"))
    titles = []

    def track(items, title, total):
        titles.append(title)
        return items

    segments = find_segments(capture, find_head(capture, None), CONFIG, tmp_path, track)
    assert len(segments.points) == len(found.points)
    first, second = (CONFIG.stereo.orientation.window, tmp_path), (CONFIG.noise.window, tmp_path / "wide")
    assert used == ([first, second] if grainy and not curly else [first])
    again = ["orientation, noisy photographs of straight hair"] if len(used) == 2 else []
    assert [title for title in titles if title.startswith("orientation")] == ["orientation", *again]
    # Whether the hair is straight is found out by tracing it.
    assert ("spreading hair over its room" in titles) == (grainy and not curly)


def test_the_window_is_all_that_changes(capture: Capture, monkeypatch: pytest.MonkeyPatch):
    used, found = [], true_segments(combed_strands(60))
    monkeypatch.setattr(stereo_module, "reconstruct", lambda *given: used.append(given[2]) or found)
    monkeypatch.setattr(stereo_module, "noisy", lambda *_: True)
    monkeypatch.setattr(stereo_module, "find_course", lambda *_: SimpleNamespace(curls=None))
    find_segments(capture, find_head(capture, None), CONFIG, None, lambda items, *_: items)
    narrow, wide = used
    assert wide == replace(narrow, orientation=replace(narrow.orientation, window=CONFIG.noise.window))
