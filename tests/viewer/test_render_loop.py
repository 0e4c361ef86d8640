import threading
import time

import pytest

from neural_strands.viewer.pace import LARGEST, SMALLEST, Pace
from neural_strands.viewer.render_loop import RenderLoop


class Recorder:
    """Draws nothing, records requests, and can be made to wait."""

    def __init__(self):
        self.drawn = []
        self.go = threading.Event()
        self.go.set()
        self.begun = threading.Event()

    def __call__(self, browser, request, size):
        self.begun.set()
        self.go.wait(60)
        self.drawn.append((browser, request, size))

    def wait_for(self, count, seconds=60.0):
        end = time.monotonic() + seconds
        while len(self.drawn) < count and time.monotonic() < end:
            time.sleep(0.005)
        return list(self.drawn)


@pytest.fixture
def loop():
    recorder = Recorder()
    made = RenderLoop(recorder, finer=(2000, 4000))
    yield made, recorder
    recorder.go.set()
    made.stop()


def test_a_request_that_rests_is_drawn_finer_and_finer_and_then_left_alone(loop):
    made, recorder = loop
    made.ask(1, "still")
    sizes = [size for _, _, size in recorder.wait_for(3)]
    assert sizes[0] < sizes[1] == 2000 < sizes[2] == 4000
    time.sleep(0.3)
    assert len(recorder.drawn) == 3


def test_no_picture_is_larger_than_the_finest():
    recorder = Recorder()
    made = RenderLoop(recorder, finer=(SMALLEST,))
    try:
        made.ask(1, "still")
        assert [size for _, _, size in recorder.wait_for(2)] == [SMALLEST, SMALLEST]
    finally:
        made.stop()


def test_only_the_newest_of_many_requests_is_drawn(loop):
    made, recorder = loop
    recorder.go.clear()
    made.ask(1, 0)
    recorder.begun.wait(60)
    for number in range(1, 50):
        made.ask(1, number)
    recorder.go.set()
    requests = [request for _, request, _ in recorder.wait_for(4)]
    assert requests == [0, 49, 49, 49]


def test_browsers_take_turns_and_quick_pictures_come_first(loop):
    made, recorder = loop
    recorder.go.clear()
    made.ask(1, "a")
    recorder.begun.wait(60)
    made.ask(2, "b")
    made.ask(1, "c")
    recorder.go.set()
    drawn = recorder.wait_for(7)
    assert [browser for browser, _, _ in drawn[:3]] == [1, 2, 1]
    assert sorted(drawn[-1:] + drawn[-2:-1])[0][2] == 4000


def test_a_browser_that_left_gets_nothing_more(loop):
    made, recorder = loop
    made.ask(1, "a")
    recorder.wait_for(1)
    made.forget(1)
    time.sleep(0.5)
    assert len(recorder.drawn) == 1


def test_a_request_that_fails_does_not_end_the_others(caplog):
    drawn = threading.Event()

    def draw(browser, request, size):
        if browser == 1:
            raise ValueError("no such picture")
        drawn.set()

    made = RenderLoop(draw)
    made.ask(1, "bad")
    made.ask(2, "good")
    assert drawn.wait(60)
    made.stop()
    assert "could not be drawn" in caplog.text


@pytest.mark.parametrize("seconds_per_megapixel", [0.2, 2.0, 20.0])
def test_the_pace_settles_at_its_aim(seconds_per_megapixel):
    pace = Pace(target=0.12)
    for _ in range(60):
        pace.took(seconds_per_megapixel * (pace.size / 1000) ** 2)
    took = seconds_per_megapixel * (pace.size / 1000) ** 2
    assert took == pytest.approx(0.12, rel=0.35) or pace.size in (SMALLEST, LARGEST)


def test_the_pace_stays_within_its_limits():
    pace = Pace(target=0.1)
    for _ in range(50):
        pace.took(100.0)
    assert pace.size == SMALLEST
    for _ in range(50):
        pace.took(1e-9)
    assert pace.size == LARGEST
