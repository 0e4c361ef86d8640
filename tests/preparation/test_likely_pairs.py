"""Which photographs are matched when there are many: those that share features, and a chain through all of them."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from neural_strands.preparation.cameras import likely_pairs as module
from neural_strands.preparation.cameras.likely_pairs import (
    FEWEST_SHARED,
    LARGEST,
    RATIO,
    largest_features,
    likely_pairs,
)

SEEN = 40
"""Features that each photograph sees."""


def strip(photographs: int, step: int, seed: int = 0) -> list[np.ndarray]:
    """Photographs along a wall of features, each `step` features farther than the last, with noise and in any order."""
    random = np.random.default_rng(seed)
    wall = random.integers(0, 200, (step * photographs + SEEN, 128))
    shots = []
    for k in range(photographs):
        seen = wall[step * k : step * k + SEEN] + random.integers(0, 20, (SEEN, 128))
        shots.append(random.permutation(seen).astype(np.uint8))
    return shots


def matches_by_loops(first: np.ndarray, second: np.ndarray) -> int:
    """A feature at a time: nearest by far, and nearest from the other side."""
    one, two = (
        [row / math.sqrt(float((row * row).sum())) for row in side.astype(np.float64)] for side in (first, second)
    )
    found = 0
    for i, a in enumerate(one):
        distances = sorted((float(((a - b) ** 2).sum()), j) for j, b in enumerate(two))
        (nearest, j), (next_nearest, _) = distances[:2]
        back = min((float(((c - two[j]) ** 2).sum()), k) for k, c in enumerate(one))[1]
        found += back == i and math.sqrt(nearest) <= RATIO * math.sqrt(next_nearest)
    return found


def test_shared_features_are_those_that_loops_find():
    shots = strip(4, 12)
    shared = module._shared_features(shots)
    for first, second in itertools.combinations(range(4), 2):
        assert shared[first, second] == shared[second, first] == matches_by_loops(shots[first], shots[second])
    assert [shared[0, k] for k in range(4)] == [0, 28, 16, 4]


def test_photographs_are_matched_with_those_that_overlap_and_with_no_others():
    shots = strip(20, 8)
    overlapping = {(i, j) for i, j in itertools.combinations(range(20), 2) if SEEN - 8 * (j - i) >= FEWEST_SHARED}
    many = {tuple(pair) for pair in likely_pairs(shots, 8).tolist()}
    assert many == overlapping
    few = {tuple(pair) for pair in likely_pairs(shots, 4).tolist()}
    assert few < overlapping
    assert few >= {(k, k + 1) for k in range(19)}
    assert few & {(k, k + 4) for k in range(16)}, "some partners are far away"


def test_the_most_alike_are_partners_even_if_they_share_little():
    shots = strip(8, SEEN - 5)
    assert FEWEST_SHARED > 5
    assert {tuple(pair) for pair in likely_pairs(shots, 4).tolist()} >= {(k, k + 1) for k in range(7)}


@pytest.mark.parametrize("partners", [2, 6])
def test_groups_that_share_nothing_are_joined_by_a_single_pair(partners: int):
    shots = strip(6, 8, seed=1) + strip(5, 8, seed=2)
    pairs = likely_pairs(shots, partners)
    graph = np.zeros((11, 11))
    graph[pairs[:, 0], pairs[:, 1]] = 1
    assert connected_components(graph, directed=False)[0] == 1
    assert sum(first < 6 <= second for first, second in pairs.tolist()) == 1


def test_photographs_without_features_are_in_a_pair_as_well():
    shots = [np.zeros((0, 128), np.uint8), np.zeros((1, 128), np.uint8), *strip(2, 4)]
    assert set(likely_pairs(shots, 2).ravel().tolist()) == {0, 1, 2, 3}


def test_the_largest_features_are_compared():
    random = np.random.default_rng(0)
    descriptors = random.integers(0, 256, (3 * LARGEST, 128), dtype=np.uint8)
    scales = random.permutation(3 * LARGEST).astype(np.float32)
    kept = largest_features(descriptors, scales)
    assert kept.shape == (LARGEST, 128)
    assert np.array_equal(kept[0], descriptors[scales.argmax()])
    assert np.array_equal(kept[-1], descriptors[np.flatnonzero(scales == 2 * LARGEST)[0]])
