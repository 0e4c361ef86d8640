"""Progress is silent when nobody watches."""

import pytest

from neural_strands.foundation.progress import progress_bar, track


def test_track_yields_everything_and_prints_nothing(capsys: pytest.CaptureFixture):
    assert list(track(range(5), "counting")) == [0, 1, 2, 3, 4]
    assert list(track((n for n in range(3)), "counting", total=3)) == [0, 1, 2]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == ""


def test_bar_is_disabled_without_a_terminal():
    assert progress_bar().disable
