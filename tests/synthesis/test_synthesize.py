"""A tiny capture from end to end: what is written is what was rendered, masks see what the strands' projection says."""

import importlib.util
from dataclasses import replace

import pytest
import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import read_head
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis import backend
from neural_strands.synthesis.dome import DomeConfig
from neural_strands.synthesis.groom import make_groom
from neural_strands.synthesis.path_tracer import PathTracer, TracingConfig, turned_about_y, without_fireflies
from neural_strands.synthesis.styles import MELANIN, STYLES
from neural_strands.synthesis.synthesize import SynthesisConfig, check_fit, synthesize

CONFIG = SynthesisConfig(DomeConfig(views=4, resolution=64), TracingConfig(samples=2, passes=1))
needs_mitsuba = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed")


class Stop(Exception):
    """Stands for the user's Ctrl-C."""


@pytest.fixture(scope="module")
def groom() -> Strands:
    return make_groom(mannequin(), STYLES["wavy"], MELANIN["brown"], 500, torch.Generator().manual_seed(0))


def test_lights_turn_about_the_vertical():
    # A quarter turn takes what is in front (+z) to the left of the head (+x); heights and distances stay.
    assert turned_about_y((0.0, 2.0, 1.0), 90.0) == pytest.approx((1.0, 2.0, 0.0), abs=1e-12)
    assert turned_about_y((0.95, 2.5, 1.35), 0.0) == (0.95, 2.5, 1.35)
    assert turned_about_y(turned_about_y((0.3, 0.1, -0.7), 25.0), -25.0) == pytest.approx((0.3, 0.1, -0.7))


@pytest.mark.slow
@needs_mitsuba
def test_a_tiny_capture_stopped_and_gone_on_with(tmp_path, groom, monkeypatch):
    folder, seen = tmp_path / "capture", []
    image = PathTracer.image

    def stopping(self, camera, seed):
        if len(seen) == 2:
            raise Stop
        seen.append(camera.name)
        return image(self, camera, seed)

    monkeypatch.setattr(PathTracer, "image", stopping)
    with pytest.raises(Stop):
        synthesize(folder, mannequin(), groom, CONFIG, {"style": "wavy"})
    assert not (folder / "transforms.json").exists()
    first = {path.name: path.read_bytes() for path in (folder / "images").iterdir()}
    assert sorted(first) == ["000.png", "001.png"]
    monkeypatch.setattr(PathTracer, "image", image)

    changed = replace(CONFIG, tracing=replace(CONFIG.tracing, samples=3))
    with pytest.raises(InputError, match="samples: 2 there, 3 now"):
        synthesize(folder, mannequin(), groom, changed, {"style": "wavy"})
    assert synthesize(folder, mannequin(), groom, CONFIG, {"style": "wavy"}) == 2
    assert {name: (folder / "images" / name).read_bytes() for name in first} == first
    assert synthesize(folder, mannequin(), groom, CONFIG, {"style": "wavy"}) == 0

    capture = Capture.load(folder)
    assert len(capture) == 4
    _truth_equals_what_was_rendered(capture, groom)
    for view in range(4):
        _mask_agrees_with_projected_strands(capture, view)
        assert 0.1 < float(capture.image(view).mean()) < 0.9


def _truth_equals_what_was_rendered(capture: Capture, groom: Strands) -> None:
    assert capture.ground_truth is not None
    assert (capture.ground_truth.points - groom.points).abs().max() < 1e-5
    head = read_head(capture)
    assert head is not None
    assert torch.allclose(head.mesh.vertices, mannequin().mesh.vertices, atol=1e-6)
    assert head.scalp_faces is not None
    assert torch.equal(head.scalp_faces, mannequin().scalp_faces)


def _mask_agrees_with_projected_strands(capture: Capture, view: int) -> None:
    """Hair in the mask lies where strands project; strands in front of everything of the head are in the mask."""
    mask, person = capture.hair_mask(view), capture.person_mask(view)
    assert mask is not None
    assert person is not None
    assert (person >= mask - 0.01).all()
    camera = capture.cameras[view]
    points = capture.ground_truth.points
    fine = torch.stack([torch.lerp(points[:, :-1], points[:, 1:], t) for t in (0.0, 0.25, 0.5, 0.75)], dim=2)
    pixels, depth = camera.project(fine.reshape(-1, 3))
    column, row = pixels.long().unbind(dim=-1)
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    hit = torch.zeros(camera.height, camera.width, dtype=torch.bool)
    hit[row[inside], column[inside]] = True
    near = torch.nn.functional.max_pool2d(hit[None, None].float(), 3, 1, 1)[0, 0] > 0
    assert float(mask[~near].max()) == 0.0
    head_depth = camera.project(mannequin().mesh.vertices)[1].min()
    front = inside & (depth < head_depth - 0.001)
    background = person[row[front], column[front]]
    assert (background > 0.0).float().mean() > 0.98 if int(front.sum()) else True
    # The head hides the hair behind it: masks hold less than all that strands project to.
    assert 0.05 < float(mask.mean()) <= float(near.float().mean())


def test_without_mitsuba_one_sentence_names_the_extra(monkeypatch):
    def absent(name):
        raise ImportError(name)

    monkeypatch.setattr(backend.importlib, "import_module", absent)
    with pytest.raises(InputError, match=r"pip install neural-strands\[synthesis\]"):
        backend.load_mitsuba()


def test_grooms_in_other_units_or_places_are_refused(groom):
    with pytest.raises(InputError, match="convert --scale"):
        check_fit(mannequin(), Strands(groom.points * 100))
    with pytest.raises(InputError, match="roots on the head"):
        check_fit(mannequin(), Strands(groom.points + 0.5))


def test_fireflies_are_cut_and_the_rest_is_kept():
    passes = torch.full((4, 9, 9, 3), 0.2)
    passes[2, 4, 4] = 50.0
    calm = without_fireflies(passes)
    assert torch.allclose(calm[0], torch.full((9, 3), 0.2))
    # One pass of four may shine 2.5 times as bright as its surroundings, and 0.02: (3 * 0.2 + 0.52) / 4.
    assert torch.allclose(calm[4, 4], torch.full((3,), 0.28), atol=1e-6)
