"""Looks of pixels: colour and texture, each by itself, and what a histogram says of both."""

import numpy as np
import pytest

from neural_strands.pictures.looks import COHERENCES, LookHistogram, look_cells

SIDE = 96


def streaks(strength: float, mean: float = 100.0) -> np.ndarray:
    """Grey vertical streaks, 5 pixels apart."""
    row = mean + strength * np.sin(2 * np.pi * np.arange(SIDE) / 5.0)
    return np.repeat(np.broadcast_to(row, (SIDE, SIDE))[..., None], 3, axis=2).round().astype(np.uint8)


def inner(cells: np.ndarray) -> np.ndarray:
    return cells[16:-16, 16:-16]


def test_streaks_are_coherent_and_noise_is_not() -> None:
    noise = 100 + 10 * np.random.default_rng(0).standard_normal((SIDE, SIDE, 1))
    lines, speckle = (
        inner(look_cells(picture))[..., 1] % COHERENCES
        for picture in (streaks(10.0), np.repeat(noise, 3, axis=2).clip(0, 255).astype(np.uint8))
    )
    assert lines.min() == COHERENCES - 1
    assert (speckle == COHERENCES - 1).mean() < 0.1


def test_four_times_the_contrast_is_four_cells_stronger() -> None:
    weak, strong = (inner(look_cells(streaks(size)))[..., 1] // COHERENCES for size in (10.0, 40.0))
    assert abs(float(strong.mean() - weak.mean()) - 4.0) <= 1.0


def test_texture_does_not_follow_exposure() -> None:
    dark, bright = (inner(look_cells(streaks(0.1 * mean, mean)))[..., 1] for mean in (100.0, 200.0))
    assert abs(float((bright // COHERENCES).mean() - (dark // COHERENCES).mean())) <= 1.0


def test_hair_is_told_from_skin_of_the_same_colour() -> None:
    hair, skin = look_cells(streaks(15.0)), look_cells(streaks(1.0))
    of_hair, of_skin = (LookHistogram.of([cells.reshape(-1, 2)]) for cells in (hair, skin))
    # Cells of textures alone: the colours of both are made equal.
    for cells, more, less in ((hair, of_hair, of_skin), (skin, of_skin, of_hair)):
        texture = inner(cells)[..., 1]
        assert (more.texture[texture] > 3 * less.texture[texture]).mean() > 0.9


def test_a_histogram_is_a_density_and_nothing_is_impossible() -> None:
    red = np.zeros((4, 4, 3), dtype=np.uint8)
    red[..., 0] = 200
    histogram = LookHistogram.of([look_cells(red).reshape(-1, 2), np.zeros((0, 2), dtype=np.int64)])
    assert histogram.colour.mean() == pytest.approx(1.0)
    assert histogram.texture.mean() == pytest.approx(1.0)
    assert histogram.colour.min() > 0
    assert histogram.texture.min() > 0
    blue = red[..., ::-1].copy()
    assert histogram(look_cells(red)).min() > 10 * histogram(look_cells(blue)).max()


def test_weights_and_empty_views() -> None:
    cells = look_cells(np.concatenate([streaks(0.0), streaks(0.0, 200.0)])).reshape(-1, 2)
    half = np.arange(len(cells)) < len(cells) // 2
    weighted = LookHistogram.of([cells], [half.astype(float)])
    chosen = LookHistogram.of([cells[half]])
    np.testing.assert_allclose(weighted.colour, chosen.colour)
    assert np.all(LookHistogram.of([]).colour == 1.0)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_a_look_is_taken_out_of_a_mixture(share: float) -> None:
    random = np.random.default_rng(0)

    def pixels(count: int, mean: float, contrast: float) -> np.ndarray:
        """Noise around a grey, as a strip that is wide enough for its textures."""
        grey = mean + contrast * random.standard_normal((count // SIDE, SIDE, 1))
        return look_cells(np.repeat(grey, 3, axis=2).clip(0, 255).astype(np.uint8)).reshape(-1, 2)

    count = 300 * SIDE
    hair = LookHistogram.of([pixels(count, 60.0, 20.0)])
    clothes = pixels(round((1 - share) * count), 40.0, 3.0)
    mixture = LookHistogram.of([np.concatenate([pixels(round(share * count), 60.0, 20.0), clothes])])
    assert mixture.largest_share(hair) == pytest.approx(share, abs=0.07)
    rest, alone = mixture.without(hair, share), LookHistogram.of([clothes])
    assert np.abs(rest.colour - alone.colour).mean() < 0.1 * np.abs(mixture.colour - alone.colour).mean() + 0.05
    assert np.abs(rest.texture - alone.texture).mean() < 0.3 * np.abs(mixture.texture - alone.texture).mean() + 0.05


def test_a_look_may_be_another_one_whole() -> None:
    hair = LookHistogram.of([look_cells(streaks(15.0)).reshape(-1, 2)])
    assert hair.largest_share(hair) == pytest.approx(1.0)
