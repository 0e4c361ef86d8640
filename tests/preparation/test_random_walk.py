"""The random walk against a dense solve."""

import numpy as np

from neural_strands.preparation.masks.random_walk import CONTRAST, LEAST_LINK, random_walk


def dense(picture: np.ndarray, evidence: np.ndarray, strength: float) -> np.ndarray:
    """The same minimum by building the whole matrix, pixel by pixel."""
    height, width = evidence.shape
    colour = picture.astype(np.float64) / 255
    matrix = strength * np.eye(height * width)
    for row in range(height):
        for column in range(width):
            for down, right in ((0, 1), (1, 0)):
                other = row + down, column + right
                if other[0] < height and other[1] < width:
                    gap = ((colour[row, column] - colour[other]) ** 2).sum()
                    link = max(np.exp(-CONTRAST * gap), LEAST_LINK)
                    i, j = row * width + column, other[0] * width + other[1]
                    matrix[[i, j], [i, j]] += link
                    matrix[[i, j], [j, i]] -= link
    return np.linalg.solve(matrix, strength * evidence.ravel()).reshape(height, width)


def test_it_solves_its_system():
    random = np.random.default_rng(0)
    picture = random.integers(0, 256, (9, 7, 3), dtype=np.uint8)
    evidence = random.random((9, 7))
    np.testing.assert_allclose(random_walk(picture, evidence, 0.2), dense(picture, evidence, 0.2), atol=2e-4)


def test_evidence_spreads_up_to_an_edge():
    picture = np.zeros((20, 20, 3), np.uint8)
    picture[:, 10:] = 255
    evidence = np.full((20, 20), 0.5)
    evidence[10, 3], evidence[10, 16] = 1.0, 0.0
    walked = random_walk(picture, evidence, 0.01)
    assert (walked[:, :10] > 0.5).all()
    assert (walked[:, 10:] < 0.5).all()
