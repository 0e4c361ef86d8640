"""The split of a rendering's error: parts add up, and are those of errors whose place and spectrum are known."""

import json
import math
from types import SimpleNamespace

import pytest
import torch
from matplotlib.image import imread
from tiny_capture import write_capture

from neural_strands.capture.capture import Capture
from neural_strands.evaluation.image_metrics import psnr
from neural_strands.model.hair_model import HairModelConfig

SIDE = 64


@pytest.fixture(scope="module")
def error_split(benchmark_module):
    return benchmark_module("quality", "error_split")


@pytest.fixture(scope="module")
def error_map(benchmark_module):
    return benchmark_module("quality", "error_map")


def grey(values: torch.Tensor) -> torch.Tensor:
    return values[..., None].expand(*values.shape, 3).contiguous()


def disc(radius: float) -> torch.Tensor:
    """Pixels of a disc in the middle of the picture."""
    away = torch.arange(SIDE) + 0.5 - SIDE / 2
    return (away[:, None].square() + away.square()).sqrt() < radius


def test_parts_of_every_split_add_up_to_the_squared_error(error_split, generator):
    rendered, photograph = (torch.rand(SIDE, SIDE, 3, generator=generator) for _ in range(2))
    hair = disc(25) & (torch.rand(SIDE, SIDE, generator=generator) > 0.02)
    found = error_split.split_error(rendered, photograph, hair)
    assert found.total == pytest.approx(1e5 * 10 ** (-float(psnr(rendered, photograph, hair.float())) / 10), rel=1e-5)
    assert found.parts.keys() == {"border", "fineness", "brightness", "cause"}
    for parts in found.parts.values():
        assert len(parts) == 3
        assert sum(parts.values()) == pytest.approx(found.total, rel=1e-5)
    for shares in found.pixels.values():
        assert sum(shares.values()) == pytest.approx(100)


@pytest.mark.parametrize("half_waves", [1, 6, 20, 45, 63])
def test_waves_are_in_the_bands_that_gaussians_pass(error_split, half_waves):
    """A cosine with mirrored ends keeps its form in a discrete Gaussian, whose gain is exp(sigma^2 (cos omega - 1))."""
    omega = math.pi * half_waves / SIDE
    wave = 0.1 * torch.cos(omega * (torch.arange(SIDE) + 0.5)).expand(SIDE, SIDE)
    photograph = torch.full((SIDE, SIDE, 3), 0.5)
    found = error_split.split_error(photograph + grey(wave), photograph, torch.ones(SIDE, SIDE, dtype=torch.bool))
    one, four = (math.exp(sigma**2 * (math.cos(omega) - 1)) for sigma in (1.0, 4.0))
    expected = [0.005 * share * 1e5 for share in (1 - one, one - four, four)]
    assert list(found.parts["fineness"].values()) == pytest.approx(expected, abs=0.02)
    assert found.total == pytest.approx(500, rel=1e-4)


def test_the_border_is_divided_by_the_distance_to_what_is_not_hair(error_split):
    hair = disc(20)
    places, outside = torch.nonzero(hair).float(), torch.nonzero(~hair).float()
    distance = torch.cdist(places, outside).amin(dim=1)
    masks = error_split.by_border(hair)
    for mask, expected in zip(
        masks.values(), (distance <= 3, (distance > 3) & (distance <= 8), distance > 8), strict=True
    ):
        assert torch.equal(mask[hair], expected)
        assert not mask[~hair].any()
    photograph = torch.full((SIDE, SIDE, 3), 0.4)
    rim = masks["within 3 px"]
    found = error_split.split_error(photograph + 0.1 * grey(rim.float()), photograph, hair)
    assert found.parts["border"]["within 3 px"] == pytest.approx(found.total, rel=1e-5)
    assert found.parts["cause"]["outline"] == pytest.approx(found.total, rel=1e-5)
    assert found.pixels["border"]["within 3 px"] == pytest.approx(100 * float(rim.sum() / hair.sum()))


def test_what_lies_outside_of_the_hair_does_not_count(error_split, generator):
    hair, photograph = disc(20), torch.rand(SIDE, SIDE, 3, generator=generator)
    rendered = photograph + 0.1 * grey(hair.float())
    noisy = torch.where(hair[..., None], rendered, torch.rand(SIDE, SIDE, 3, generator=generator))
    found, other = (error_split.split_error(image, photograph, hair) for image in (rendered, noisy))
    assert found == other
    # A constant error is as smooth as can be, up to the border.
    assert found.parts["fineness"]["coarser than 4 px"] == pytest.approx(found.total, rel=1e-4)
    deep = 100 - found.pixels["border"]["within 3 px"]
    assert found.parts["cause"]["light and colour"] == pytest.approx(found.total * deep / 100, rel=1e-4)


def test_a_missing_and_a_wrong_highlight_are_told_apart(error_split):
    hair = torch.zeros(SIDE, SIDE, dtype=torch.bool)
    hair[2:62, 2:62] = True
    photograph, rendered = (torch.full((SIDE, SIDE, 3), 0.3) for _ in range(2))
    photograph[10:30, 10:30] = 0.6
    rendered[10:30, 10:30] = 0.5
    rendered[40:55, 40:55] = 0.8
    found = error_split.split_error(rendered, photograph, hair)
    # Of 3,600 pixels, the 36 brightest: 12 x 12 means of the photograph's square are equal, and all of them count.
    assert found.pixels["brightness"]["highlights of the photograph"] == pytest.approx(100 * 144 / 3600)
    assert found.parts["brightness"]["highlights of the photograph"] == pytest.approx(144 * 0.01 / 3600 * 1e5, rel=1e-4)
    # 7 x 7 means of the rendering's square are equal, too.
    assert found.pixels["brightness"]["of the rendering alone"] == pytest.approx(100 * 49 / 3600)
    assert found.parts["brightness"]["of the rendering alone"] == pytest.approx(49 * 0.25 / 3600 * 1e5, rel=1e-4)


def test_the_map_has_the_colours_of_the_causes(error_map):
    hair, photograph = disc(28), torch.full((SIDE, SIDE, 3), 0.4)
    fine = torch.where((torch.arange(SIDE)[:, None] + torch.arange(SIDE)) % 2 == 0, 0.3, -0.3)
    error = torch.where(torch.arange(SIDE) < SIDE // 2, torch.full((SIDE, SIDE), 0.3), fine)
    picture = error_map.cause_map(photograph + grey(error), photograph, hair)
    places = {
        "light and colour": (32, 16),
        "detail": (32, 48),
        "outline": (32, 5),
    }
    for cause, place in places.items():
        torch.testing.assert_close(picture[place], torch.tensor(error_map.COLOURS[cause]))
    assert (picture[~hair] == 0).all()
    assert (error_map.cause_map(photograph, photograph, hair) == 0).all()


def test_every_view_is_drawn_and_counted_once(error_map, tmp_path, monkeypatch, capsys):
    """A renderer that is too bright by a twentieth in the first view and by a tenth in the second."""
    write_capture(tmp_path / "ball", views=5)
    capture = Capture.load(tmp_path / "ball")
    views = capture.views_on()
    offsets = {views.cameras[0].name: 0.05, views.cameras[3].name: 0.1}

    def render(camera):
        index = [each.name for each in views.cameras].index(camera.name)
        return SimpleNamespace(rgb=views.image(index) + offsets[camera.name], alpha=views.hair_mask(index))

    model = SimpleNamespace(config=HairModelConfig())
    renderer = SimpleNamespace(render=render, model=model)
    contents = SimpleNamespace(renderer=renderer, capture=capture, shown=[0, 3], held_out=True)
    monkeypatch.setattr(error_map, "open_run", lambda run, device: contents)
    error_map.main(error_map.Arguments(tmp_path / "run"))
    found = json.loads(capsys.readouterr().out)
    assert found["views"] == 2
    assert found["total"] == pytest.approx((250 + 1000) / 2, rel=1e-3)
    assert [found["by_view"][name]["total"] for name in ("000", "003")] == pytest.approx([250, 1000], rel=1e-3)
    assert sum(found["parts"]["cause"].values()) == pytest.approx(found["total"], abs=0.2)
    for name in ("000", "003"):
        assert imread(tmp_path / "run" / "error_map" / f"{name}.png").ndim == 3
    assert not model.config.mixed_precision
