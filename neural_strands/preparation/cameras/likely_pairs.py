"""Which pairs of photographs are worth matching, when there are too many to match them all.

Photographs are compared by a few hundred of their largest features, which takes a thousandth of the time of a full
match (preemptive matching: Wu, Towards Linear-time Incremental Structure from Motion, 3DV 2013, section 3).
"""

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt8
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

LARGEST = 500
"""Number of features of each photograph that are compared."""
RATIO = 0.8
"""Largest distance of a match, relative to that of the second nearest feature (Lowe 2004, section 7.1)."""
FEWEST_SHARED = 8
"""Matches by which photographs that are not among the most alike may be partners; fewer are likely to be chance."""


def largest_features(
    descriptors: UInt8[np.ndarray, "feature 128"], scales: Float[np.ndarray, " feature"]
) -> UInt8[np.ndarray, "largest 128"]:
    """The descriptors of a photograph's largest features, by which `likely_pairs` compares it."""
    return descriptors[np.argsort(-scales, kind="stable")[:LARGEST]]


def likely_pairs(descriptors: Sequence[UInt8[np.ndarray, "_ 128"]], partners: int) -> Int[np.ndarray, "pair 2"]:
    """Pairs of photographs that look as if they overlap: about `partners` for each photograph.

    Half of a photograph's partners are those most like it, mostly its neighbours, however few features they share; the
    others are spread over the rest that share features with it, because distant cameras keep a model from bending. A
    maximum spanning tree is added, so that groups of similar photographs stay connected.

    Args:
        descriptors: SIFT descriptors of the largest features of each photograph.
        partners: how many partners each photograph chooses.

    Returns:
        Sorted pairs, the smaller index first.
    """
    shared = _shared_features(descriptors)
    chosen = np.zeros(shared.shape, dtype=bool)
    for own, row in enumerate(shared):
        ranked = np.argsort(-row, kind="stable")
        near, far = ranked[: partners // 2], ranked[partners // 2 :]
        far = far[row[far] >= FEWEST_SHARED]
        spread = np.linspace(0, len(far) - 1, min(partners - partners // 2, len(far))).round().astype(int)
        chosen[own, near] = chosen[own, far[spread]] = True
    # The smallest tree of negative weights is the largest; one more, because a weight of zero is no edge.
    tree = minimum_spanning_tree(coo_array(np.triu(-(shared + 1), 1)))
    chosen |= tree.toarray() != 0
    return np.argwhere(np.triu(chosen | chosen.T, 1))


def _shared_features(descriptors: Sequence[UInt8[np.ndarray, "_ 128"]]) -> Int[np.ndarray, "photograph photograph"]:
    """For each two photographs, how many of their features are each other's nearest by far."""
    units = [_normalised(one) for one in descriptors]
    shared = np.zeros((len(units), len(units)), dtype=np.int64)
    for first, second in itertools.combinations(range(len(units)), 2):
        shared[first, second] = shared[second, first] = _mutual_matches(units[first], units[second])
    return shared


def _normalised(descriptors: UInt8[np.ndarray, "feature 128"]) -> Float[np.ndarray, "feature 128"]:
    """Descriptors of length 1."""
    values = descriptors.astype(np.float32)
    return values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-6)


def _mutual_matches(first: Float[np.ndarray, "one 128"], second: Float[np.ndarray, "two 128"]) -> int:
    """Number of features that are each other's nearest, and nearer than `RATIO` times the second nearest."""
    if min(len(first), len(second)) < 2:
        return 0
    likeness = first @ second.T
    nearest, back = likeness.argmax(axis=1), likeness.argmax(axis=0)
    best = -np.partition(-likeness, 1, axis=1)[:, :2]
    distance = np.sqrt(np.maximum(2 - 2 * best, 0))
    mutual = back[nearest] == np.arange(len(first))
    return int((mutual & (distance[:, 0] <= RATIO * distance[:, 1])).sum())
