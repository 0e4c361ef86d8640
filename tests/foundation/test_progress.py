"""Progress: a bar on a terminal, one line per minute elsewhere, nothing for short loops."""

import itertools

import pytest
from counted_loops import CountedLoops

from neural_strands.foundation.progress import Feedback, Steps, progress_bar, track


def test_track_yields_everything_and_prints_nothing(capsys: pytest.CaptureFixture):
    assert list(track(range(5), "counting")) == [0, 1, 2, 3, 4]
    assert list(track((n for n in range(3)), "counting", total=3)) == [0, 1, 2]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == ""


def test_without_a_terminal_a_long_loop_says_where_it_is(capsys: pytest.CaptureFixture):
    seconds = itertools.count(0, 15)
    assert list(track(range(9), "counting", 9, lambda: next(seconds))) == list(range(9))
    captured = capsys.readouterr()
    assert captured.out == ""
    # 15 s an item, read before each: the fourth begins after 60 s, the eighth after 120 s.
    assert captured.err == "counting: 3 of 9\ncounting: 7 of 9\n"


def test_bar_is_disabled_without_a_terminal():
    assert progress_bar().disable


def test_by_default_nobody_is_told(capsys: pytest.CaptureFixture):
    feedback = Feedback()
    assert not feedback.heard
    assert Feedback(print).heard
    feedback.say("anything")
    assert list(feedback.track(range(3), "counting", 3)) == [0, 1, 2]
    captured = capsys.readouterr()
    assert captured.out + captured.err == ""


def test_steps_are_counted_to_the_last():
    counted = CountedLoops()
    steps = Steps(counted.track, "counting", 3)
    (loop,) = counted.loops
    for done in range(3):
        assert (loop.done, loop.ended) == (done, False)
        steps.done()
    assert loop.complete
    # Nothing is left to count.
    steps.done()
    assert loop.complete


def test_no_steps_are_complete_at_once():
    counted = CountedLoops()
    Steps(counted.track, "counting", 0)
    assert counted.loops[0].complete
