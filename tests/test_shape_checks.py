"""Functions, methods, properties and dataclasses refuse wrong shapes and types."""

from dataclasses import dataclass

import jaxtyping
import pytest
import torch
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import Float, Int64
from shape_checks import checked
from torch import Tensor

from neural_strands.geometry.strands import lengths


@checked
def pick(
    values: Float[Tensor, "row column"], rows: Int64[Tensor, " pick"], count: int
) -> Float[Tensor, "{count} pick"]:
    return values[rows].T[:count] if count else values


@checked
def rows_only(values: Float[Tensor, "row column"], other: "Float[Tensor, ' row']") -> Float[Tensor, " row"]:
    return values[:, 0] + other[: len(values)]


@checked
@dataclass
class Rows:
    values: Float[Tensor, "row column"]
    weights: Float[Tensor, " row"]

    @classmethod
    @checked
    def single(cls, values: Float[Tensor, " column"]) -> "Rows":
        return cls(values[None], torch.ones(1))

    @property
    @checked
    def column(self) -> Float[Tensor, " row"]:
        return self.values


@checked
def of_unknown(value: "NotKnownHere", count: int) -> int:  # pyright: ignore[reportUndefinedVariable]  # noqa: F821
    return count


VALUES = torch.zeros(4, 3)


def test_right_calls_pass():
    assert pick(VALUES, torch.tensor([0, 1]), 2).shape == (2, 2)
    assert rows_only(VALUES, torch.zeros(4)).shape == (4,)
    assert Rows.single(VALUES[0]).values.shape == (1, 3)
    assert of_unknown("anything", 3) == 3


@pytest.mark.parametrize(
    "call",
    [
        lambda: pick(VALUES[0], torch.tensor([0]), 1),
        lambda: pick(VALUES, torch.tensor([0.0]), 1),
        lambda: pick(VALUES, torch.tensor([0]), 1.0),
        lambda: pick(VALUES, torch.tensor([0]), 0),
        lambda: pick(VALUES, torch.tensor([0]), count=5),
        lambda: rows_only(VALUES, torch.zeros(5)),
        lambda: Rows(VALUES, torch.zeros(3)),
        lambda: Rows.single(VALUES),
        lambda: Rows(VALUES, torch.zeros(4)).column,
        lambda: of_unknown(None, "three"),
        lambda: lengths(torch.zeros(2, 3)),
    ],
)
def test_wrong_calls_are_refused(call):
    with pytest.raises(BeartypeCallHintViolation):
        call()


def test_the_refusal_names_the_sizes():
    with pytest.raises(BeartypeCallHintViolation) as refused:
        rows_only(VALUES, torch.zeros(5))
    assert "row=4" in "".join(refused.value.__notes__)


def test_nothing_is_checked_if_switched_off(monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    assert rows_only(VALUES, torch.zeros(5)).shape == (4,)
