"""Votes on hair: each view counts once at each vertex that it shows."""

import numpy as np

from neural_strands.preparation.masks.zones import Ballot, Shown


def test_votes_are_means_over_the_views_that_show_a_vertex():
    ballot = Ballot(4)
    first, second = np.array([[1.0, 0.0], [0.0, 0.0]]), np.array([[0.5, 1.0], [0.0, 0.0]])
    ballot.add(Shown(np.array([0, 1]), np.array([[0, 0], [1, 0]])), first)
    ballot.add(Shown(np.array([0, 1, 3]), np.array([[0, 0], [1, 0], [0, 1]])), second)
    # Vertex 2 is seen by no view and vertex 3 by only one: too few to vote on it.
    np.testing.assert_allclose(ballot.shares(), [0.75, 0.5, np.nan, np.nan])
