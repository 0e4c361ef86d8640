"""Grooms for the tests of readers and writers."""

import pytest
from groom_makers import make_groom

from neural_strands.grooms.groom import Groom


@pytest.fixture
def uniform_groom() -> Groom:
    """Five strands of six points."""
    return make_groom([6] * 5)


@pytest.fixture
def ragged_groom() -> Groom:
    """Strands of 2 to 9 points."""
    return make_groom([2, 9, 3, 5])
