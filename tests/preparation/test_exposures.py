"""Exposures estimated from points that several photographs show, and photographs made alike."""

from pathlib import Path

import numpy as np
import pytest
import torch
from papered_room import photographed_room

from neural_strands.capture.colmap import read_colmap
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.preparation.cameras.calibration import calibrate
from neural_strands.preparation.cameras.exposures import (
    FEWEST_POINTS,
    SeenColours,
    equalised,
    estimate_exposures,
    noticeable_exposures,
    read_exposures,
    write_exposures,
)
from neural_strands.preparation.cameras.given import by_name
from neural_strands.preparation.cameras.register import match_photographs, register
from neural_strands.preparation.photographs.folder import read_picture, write_picture

DARKER = 0.7
"""Stops by which all photographs of the room are darker than it is drawn, so that none is burnt out."""


def walked(
    exposures: np.ndarray, random: np.random.Generator, noise: float, highlights: float, beside: int = 3
) -> SeenColours:
    """Points that `beside` neighbouring photographs of a walk show, some of them with highlights."""
    count = len(exposures)
    first = np.repeat(np.arange(count - beside + 1), 40)
    photograph = (first[:, None] + np.arange(beside)).ravel()
    point = np.repeat(np.arange(len(first)), beside)
    stops = random.normal(-2, 1, (len(first), 3))[point] + exposures[photograph]
    stops += random.normal(0, noise, stops.shape)
    lit = random.random(len(stops)) < highlights
    stops[lit] += random.uniform(0.5, 3.0, (int(lit.sum()), 1))
    return SeenColours(photograph, point, stops)


def drawn(count: int, random: np.random.Generator) -> np.ndarray:
    exposures = random.uniform(-1, 1, (count, 1)) + random.normal(0, 0.1, (count, 3))
    return exposures - np.median(exposures, axis=0)


@pytest.mark.parametrize(("noise", "highlights", "bound"), [(0.0, 0.0, 1e-9), (0.05, 0.1, 0.1)])
def test_exposures_are_found(noise: float, highlights: float, bound: float):
    random = np.random.default_rng(0)
    true = drawn(40, random)
    found = estimate_exposures(walked(true, random, noise, highlights, beside=6), len(true))
    np.testing.assert_allclose(found, true, atol=bound)


def test_a_slow_drift_along_many_photographs_is_found():
    random = np.random.default_rng(1)
    true = np.linspace(-1, 1, 121)[:, None] * np.array([1.0, 0.9, 1.1])
    found = estimate_exposures(walked(true, random, 0.02, 0.0), len(true))
    np.testing.assert_allclose(found, true, atol=0.1)


def test_photographs_with_few_points_are_taken_to_be_the_median():
    random = np.random.default_rng(2)
    true = drawn(12, random)
    seen = walked(true, random, 0.0, 0.0)
    kept = (seen.photograph != 11) | (np.cumsum(seen.photograph == 11) < FEWEST_POINTS)
    found = estimate_exposures(SeenColours(seen.photograph[kept], seen.point[kept], seen.stops[kept]), 12)
    assert (found[11] == 0).all()
    np.testing.assert_allclose(found[:11], true[:11] - np.median(true[:11], axis=0), atol=1e-9)
    none = SeenColours(np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)))
    assert (estimate_exposures(none, 5) == 0).all()


def exposed(picture: np.ndarray, stops: np.ndarray) -> np.ndarray:
    """What a camera would have stored with another exposure, without any table."""
    light = to_linear(torch.from_numpy(picture / 255.0)) * torch.from_numpy(2.0**stops)
    return (to_srgb(light).clamp(0, 1) * 255).round().byte().numpy()


def test_equalised_photographs_have_the_median_exposure():
    picture = np.random.default_rng(3).integers(20, 150, (40, 50, 3), dtype=np.uint8)
    stops = np.array([0.7, -0.4, 0.1])
    back = equalised(exposed(picture, stops), stops)
    assert np.abs(back.astype(int) - picture).max() <= 2


def test_damaged_exposures_are_one_sentence(tmp_path: Path):
    write_exposures(tmp_path, ["a.png", "b.png"], np.array([[0.0, 0.0, 0.0], [0.25, -0.5, 1.0]]))
    assert read_exposures(tmp_path)["b.png"].tolist() == [0.25, -0.5, 1.0]
    for text in ("{", "[]", '{"a.png": [1, 2]}', '{"a.png": [1, 2, 1e9]}', '{"a.png": null}'):
        (tmp_path / "exposures.json").write_text(text)
        with pytest.raises(InputError, match=r"exposures\.json"):
            read_exposures(tmp_path)


def test_photographs_that_hardly_differ_stay_as_they_are(tmp_path: Path):
    write_exposures(tmp_path, ["a.png", "b.png"], np.array([[0.0, 0.0, 0.0], [0.04, -0.05, 0.02]]))
    assert noticeable_exposures(tmp_path) is None
    write_exposures(tmp_path, [], np.zeros((0, 3)))
    assert noticeable_exposures(tmp_path) is None


@pytest.mark.slow
def test_photographs_of_a_room_are_made_alike(tmp_path: Path):
    pytest.importorskip("pycolmap")
    images, shots = photographed_room(tmp_path)
    plain = {shot.name: read_picture(images / shot.name) for shot in shots}
    true = 0.5 * drawn(len(shots), np.random.default_rng(4))
    for shot, stops in zip(shots, true, strict=True):
        write_picture(images / shot.name, exposed(plain[shot.name], stops - DARKER))
    matches, model, alike, same = (tmp_path / name for name in ("matches", "model", "alike", "same"))
    for folder in (matches, model, alike, same):
        folder.mkdir()
    match_photographs(images, shots, matches)
    points = register(images, shots, matches, model, lambda _: None)
    found = noticeable_exposures(model)
    assert found is not None
    np.testing.assert_allclose(np.stack([found[shot.name] for shot in shots]), true, atol=0.03)

    lenses, said = by_name(read_colmap(images, model), model), []
    calibrate(images, shots, lenses, points, alike, said.append, found)
    assert "up to" in said[0]
    for shot in shots:
        write_picture(images / shot.name, exposed(plain[shot.name], np.full(3, -DARKER)))
    calibrate(images, shots, lenses, points, same, said.append)
    for shot in shots:
        made, expected = (read_picture(folder / "images" / shot.name).astype(int) for folder in (alike, same))
        assert np.abs(made - expected).mean() < 1.5
