"""The memory of a frame: the estimate against what a frame takes, and the refusal before anything is allocated."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from fuzzed_input import give
from tiny_hair import tiny_hair_model

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model import frame_memory as module
from neural_strands.model.frame_memory import check_frame_memory, frame_memory
from neural_strands.model.renderer import HairRenderer


@pytest.fixture(scope="module")
def renderer() -> HairRenderer:
    return HairRenderer.of(tiny_hair_model())


def camera(renderer: HairRenderer, width: int, height: int) -> Camera:
    return turntable_cameras(renderer.strands.points, 1, (width, height))[0]


PROGRAM = """
import sys
sys.path.append(sys.argv[1])
from tiny_hair import tiny_hair_model
from neural_strands.foundation.memory import peak_resident_memory
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model.renderer import HairRenderer
renderer = HairRenderer.of(tiny_hair_model())
peaks = []
for side in (32, 900):
    renderer.render(turntable_cameras(renderer.strands.points, 1, (side, side))[0])
    peaks.append(peak_resident_memory())
print(peaks[1] - peaks[0])
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="units of the peak differ")
def test_a_frame_takes_what_is_estimated(renderer: HairRenderer):
    # Another process, because this one may have kept memory of earlier tests.
    words = [sys.executable, "-c", PROGRAM, str(Path(__file__).parents[1] / "support")]
    taken = int(subprocess.run(words, capture_output=True, text=True, check=True).stdout)
    estimate = frame_memory(renderer.strands, camera(renderer, 900, 900), renderer.model.config.supersample)
    # The tiny model's image generator is narrower than the one that was measured.
    assert 0.4 < taken / estimate < 1.2


def test_the_hair_counts_by_the_rectangle_around_it(renderer: HairRenderer):
    strands, far = renderer.strands, torch.tensor([0.0, 0.05, 20.0])
    beside = Camera.look_at(torch.tensor([0.0, 0.05, 0.02]), torch.zeros(3), 100.0, (100, 100))
    distant = Camera.look_at(far, torch.zeros(3), 100.0, (100, 100))
    assert frame_memory(strands, beside, 3) == 10_000 * (42 * 9 + 350 + 600)
    assert 0 < frame_memory(strands, distant, 3) - 10_000 * (42 * 9 + 350) < 0.001 * 10_000 * 600


def test_what_does_not_fit_is_refused_before_it_is_allocated(
    renderer: HairRenderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "free_memory", lambda: 10 * 10**9)
    sentence = r"^a frame of 8000 x 8000 pixels: expected [4-9]\d\.\d GB of free memory, found 10\.0 GB; render a sma"
    for render in (renderer.render, renderer.render_hair):
        with pytest.raises(InputError, match=sentence):
            render(camera(renderer, 8000, 8000))
    (tmp_path / "a").touch()
    assert give(lambda _: renderer.render(camera(renderer, 8000, 8000)), tmp_path / "a").kind == "refused"
    with pytest.raises(InputError, match=r"expected at most 238,609,294 pixels, found 268,435,456; render a smaller"):
        renderer.render(camera(renderer, 16384, 16384))
    check_frame_memory(renderer.strands, camera(renderer, 2500, 2500), 3)
    monkeypatch.setattr(module, "free_memory", lambda: None)
    check_frame_memory(renderer.strands, camera(renderer, 8000, 8000), 3)
