"""The true strands of a capture: what was written comes back, and anything else is one sentence."""

import io

import numpy as np
import pytest
from damage import EDIT, damage, fuzz, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st

from neural_strands.capture.ground_truth import read_ground_truth
from neural_strands.foundation.errors import InputError

STRANDS = np.arange(24, dtype=np.int16).reshape(2, 4, 3)


def test_whole_numbers_times_a_unit(tmp_path):
    np.savez(tmp_path / "a.npz", strands=STRANDS, unit=1e-3)
    found = read_ground_truth(tmp_path / "a.npz").points
    np.testing.assert_array_equal(found.numpy(), (STRANDS * 1e-3).astype(np.float32))
    np.savez(tmp_path / "b.npz", strands=STRANDS / 100)
    np.testing.assert_array_equal(read_ground_truth(tmp_path / "b.npz").points.numpy(), (STRANDS / 100).astype("f4"))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"unit": 1.0}, "an array strands"),
        ({"strands": np.zeros((3, 4))}, "strands of floats or whole numbers in shape"),
        ({"strands": np.zeros((3, 1, 3))}, "strands of two points or more, found 1"),
        ({"strands": np.full((3, 2, 3), np.nan)}, "finite numbers in strands"),
        ({"strands": STRANDS, "unit": np.ones(2)}, "unit of"),
        ({"strands": STRANDS, "unit": 0.0}, "a unit of more than 0 metres, found 0"),
        ({"strands": STRANDS, "unit": -1e-5}, "a unit of more than 0 metres"),
        ({"strands": STRANDS, "unit": 1.0}, "expected hair in metres, found something 21 across"),
        ({"strands": STRANDS, "unit": 1e300}, "beyond single precision"),
        ({"strands": np.array([["a"]])}, "plain numbers"),
    ],
)
def test_anything_else_is_one_sentence(tmp_path, arrays, message):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=message) as caught:
        read_ground_truth(tmp_path / "a.npz")
    assert "\n" not in str(caught.value)


@fuzz(100)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(tmp_path, edits):
    content = io.BytesIO()
    np.savez_compressed(content, strands=STRANDS, unit=1e-3)
    read_or_refuse(tmp_path / "a.npz", damage(content.getvalue(), edits), read_ground_truth)
