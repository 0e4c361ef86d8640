"""The shipped pictures are those that the path tracer renders, and are taken for no other capture."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.writer import CaptureWriter, quantised
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis import sample, synthesize
from neural_strands.synthesis.dome import DomeConfig
from neural_strands.synthesis.groom import make_groom
from neural_strands.synthesis.path_tracer import PathTracer, TracingConfig
from neural_strands.synthesis.sample import SAMPLE, pack_sample, sample_shows, unpack_sample
from neural_strands.synthesis.styles import MELANIN, STYLES
from neural_strands.synthesis.synthesize import SynthesisConfig

CONFIG = SynthesisConfig(DomeConfig(), TracingConfig(melanin=MELANIN["brown"]))
ORIGIN = {"style": "straight", "strands": 10_000}
needs_mitsuba = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed")


def straight(strands: int) -> Strands:
    """The demo's style of hair."""
    generator = torch.Generator().manual_seed(0)
    return make_groom(mannequin(), STYLES["straight"], MELANIN["brown"], strands, generator)


@pytest.mark.slow
@needs_mitsuba
def test_the_demo_gets_what_the_path_tracer_would_render(tmp_path, monkeypatch):
    def refuse(*_):
        raise AssertionError("path tracing")

    groom, view = straight(10_000), 5
    with monkeypatch.context() as patch:
        patch.setattr(synthesize, "load_mitsuba", refuse)
        patch.setattr(synthesize, "PathTracer", refuse)
        assert synthesize.synthesize(tmp_path, mannequin(), groom, CONFIG, ORIGIN, shipped=True) == 0
    capture = Capture.load(tmp_path)
    assert len(capture) == 24
    assert capture.ground_truth is not None
    assert (capture.ground_truth.points - groom.points).abs().max() < 1e-5

    tracer = PathTracer(mannequin(), quantised(groom), CONFIG.tracing, torch.Generator().manual_seed(0))
    rendered = tracer.image(capture.cameras[view], view)
    # A fibre scatters light so strongly that the last bits decide where a path goes; means over 8 x 8 pixels settle.
    gap = (rendered - capture.image(view)).unflatten(0, (32, 8)).unflatten(2, (32, 8)).mean(dim=(1, 3)).abs()
    assert float(gap.mean()) < 3e-3
    assert float(gap.max()) < 0.05
    masks = (capture.hair_mask(view), capture.person_mask(view))
    for shipped, traced in zip(masks, tracer.coverage(capture.cameras[view]).unbind(dim=-1), strict=True):
        assert shipped is not None
        assert (traced - shipped).abs().mean() < 2e-3


def test_other_settings_or_other_hair_are_not_what_the_pictures_show():
    record = json.loads((SAMPLE / "sample.json").read_text())
    settings, points = record["settings"], torch.rand(10_000, 100, 3)
    points[:: sample.EVERY_STRAND, :: sample.EVERY_POINT] = torch.tensor(record["points"]).unflatten(0, (50, 4))
    assert sample_shows({**settings, "head_digest": "of another processor"}, points)
    assert sample_shows(settings, points + 2e-5)
    assert not sample_shows(settings, points + 1e-3)
    assert not sample_shows(settings, points[:5000])
    assert not sample_shows({**settings, "seed": 1}, points)


def test_without_mitsuba_other_captures_leave_nothing_behind(tmp_path, monkeypatch):
    def absent():
        raise InputError("path tracing needs Mitsuba")

    monkeypatch.setattr(synthesize, "load_mitsuba", absent)
    with pytest.raises(InputError, match="needs Mitsuba"):
        synthesize.synthesize(tmp_path / "out", mannequin(), straight(300), CONFIG, ORIGIN, shipped=True)
    assert not (tmp_path / "out").exists()


def test_pictures_come_back_as_they_were_packed(tmp_path, monkeypatch):
    random = np.random.default_rng(0)
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 30.0, (12, 10), "007")
    pictures = [random.integers(0, 256, size, dtype=np.uint8) for size in ((10, 12, 3), (10, 12), (10, 12))]
    capture, points = tmp_path / "capture", torch.rand(401, 100, 3)
    CaptureWriter(capture).write_view(camera, *pictures)
    settings = {"style": "wavy", "strands_digest": "12ab"}
    (capture / "synthesis.json").write_text(json.dumps(settings))
    pack_sample(capture, [camera], points, tmp_path / "packed")
    monkeypatch.setattr(sample, "SAMPLE", tmp_path / "packed")
    assert sample_shows(settings, points)
    unpack_sample(CaptureWriter(tmp_path / "again"), [camera])
    for name in ("images", "masks", "person_masks"):
        path = Path(name) / "007.png"
        assert (tmp_path / "again" / path).read_bytes() == (capture / path).read_bytes()
