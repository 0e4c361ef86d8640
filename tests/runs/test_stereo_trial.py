"""The forecast of stereo against a machine whose speed is known."""

import logging

import cv2
import pytest
import torch
from tiny_capture import write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.config import FitConfig
from neural_strands.foundation.errors import InputError
from neural_strands.runs import stereo_trial
from neural_strands.runs.stereo_trial import stereo_seconds

CPU = torch.device("cpu")
SECONDS_A_PIXEL, SECONDS_A_PHOTOGRAPH = 1e-4, 0.5


class Machine:
    """A clock, and a stereo that takes a known time per pixel."""

    def __init__(self, result=None):
        self.now, self.rounds, self.result = 0.0, [], result

    def clock(self):
        return self.now

    def reconstruct(self, views, *_):
        logging.getLogger("neural_strands.lmvs.view_cache").warning("a view is left out")
        self.rounds.append([(camera.width, camera.height) for camera in views.cameras])
        self.now += SECONDS_A_PIXEL * sum(width * height for width, height in self.rounds[-1])
        if self.result is not None:
            raise self.result
        return torch.zeros(1)


@pytest.fixture
def capture(tmp_path, monkeypatch):
    """Photographs of 256 x 256 pixels, each of which takes a known time to read."""
    write_capture(tmp_path / "ball", views=25)
    for path in [*(tmp_path / "ball" / "images").iterdir(), *(tmp_path / "ball" / "masks").iterdir()]:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert image is not None
        cv2.imwrite(str(path), cv2.resize(image, (256, 256)))
    path = tmp_path / "ball" / "transforms.json"
    text = path.read_text().replace('"w": 64', '"w": 256').replace('"h": 64', '"h": 256')
    path.write_text(text.replace("170.0", "680.0").replace("32.0", "128.0"))
    return Capture.load(tmp_path / "ball")


def slow_reading(machine, monkeypatch):
    read = Capture.image

    def image(self, index, device="cpu"):
        machine.now += SECONDS_A_PHOTOGRAPH
        return read(self, index, device)

    monkeypatch.setattr(Capture, "image", image)


def test_the_trial_finds_the_speed_of_the_machine(capture, monkeypatch, caplog):
    machine = Machine()
    monkeypatch.setattr(stereo_trial, "reconstruct", machine.reconstruct)
    slow_reading(machine, monkeypatch)
    found = stereo_seconds(capture, find_head(capture), FitConfig(), CPU, machine.clock)
    # Of the 25 views, 5 are held out.
    assert found == pytest.approx(20 * (SECONDS_A_PHOTOGRAPH + SECONDS_A_PIXEL * 256 * 256))
    assert machine.rounds == [3 * [(96, 96)], 9 * [(96, 96)]]
    assert caplog.text == ""
    assert logging.getLogger("neural_strands.lmvs").level == logging.NOTSET


def test_no_trial_is_possible_where_reduced_photographs_show_no_hair(capture, monkeypatch):
    machine = Machine(InputError("expected hair in at least two views, found it in 0; check images and masks."))
    monkeypatch.setattr(stereo_trial, "reconstruct", machine.reconstruct)
    assert stereo_seconds(capture, find_head(capture), FitConfig(), CPU, machine.clock) is None
    assert logging.getLogger("neural_strands.lmvs").level == logging.NOTSET


def test_the_real_stereo_runs(capture):
    found = stereo_seconds(capture.subset(range(4)), find_head(capture), FitConfig(), CPU)
    assert found is not None
    assert found > 0
