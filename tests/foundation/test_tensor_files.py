"""Checkpoints are not trusted: the result is tensors and plain values in the expected structure, or one sentence."""

import io
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from damage import EDIT, damage, fuzz, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st
from safetensors import safe_open

from neural_strands.foundation.tensor_files import adam_state, difference, read_tensors, restore_adam, safetensors_bytes


def saved(content: object, **options: bool) -> bytes:
    buffer = io.BytesIO()
    torch.save(content, buffer, **options)
    return buffer.getvalue()


def read(path: Path) -> Any:
    return read_tensors(path, "a checkpoint", "start anew")


def test_safetensors_have_the_same_bytes_every_time_and_are_read_back(tmp_path: Path):
    tensors = {"b": torch.arange(3.0), "a": torch.ones(2, 2, dtype=torch.int64)}
    notes = {name: f"{name} \u00fc\n" for name in "zyxwvutsr"}
    written = {safetensors_bytes(tensors, dict(order)) for order in (notes.items(), reversed(notes.items()))}
    written |= {safetensors_bytes(tensors, notes) for _ in range(5)}
    assert len(written) == 1
    path = tmp_path / "a.safetensors"
    path.write_bytes(written.pop())
    with safe_open(path, "pt") as found:
        assert found.metadata() == notes
        assert sorted(found.keys()) == ["a", "b"]
        assert all(torch.equal(found.get_tensor(name), tensors[name]) for name in tensors)


def test_content_comes_back(tmp_path):
    (tmp_path / "a.pt").write_bytes(saved({"a": torch.arange(3), "b": [1, None, "c"]}))
    found = read(tmp_path / "a.pt")
    assert torch.equal(found["a"], torch.arange(3))
    assert found["b"] == [1, None, "c"]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no",
        pickle.dumps({"a": 1}),
        pickle.dumps(Path),
        saved(Path("a")),
        saved({"a": torch.zeros(3)})[:300],
        saved({"a": torch.zeros(3)}, _use_new_zipfile_serialization=False),
    ],
)
def test_what_is_no_checkpoint_is_one_sentence(tmp_path, content):
    refusal = read_or_refuse(tmp_path / "a.pt", content, read)
    assert refusal.startswith(f"{tmp_path / 'a.pt'}: expected a checkpoint, found something else (")
    assert refusal.endswith("; start anew.")


@fuzz(150)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(tmp_path: Path, edits: list):
    read_or_refuse(tmp_path / "a.pt", damage(saved({"a": torch.zeros(50), "b": [1, None]}), edits), read)


def adam(steps: int) -> tuple[torch.optim.Adam, list[torch.nn.Parameter]]:
    parameters = [torch.nn.Parameter(torch.ones(2, 3)), torch.nn.Parameter(torch.ones(4))]
    optimiser = torch.optim.Adam([{"params": parameters, "lr": 0.1, "rate": 0.1}])
    for _ in range(steps):
        optimiser.zero_grad()
        # The second has no gradient, hence no moments.
        parameters[0].sum().backward()
        optimiser.step()
    return optimiser, parameters


def test_equal_structures_do_not_differ():
    trained, fresh = adam(2)[0], adam(0)[0]
    content = {"step": 3, "model": {"a": torch.ones(2)}, "optimiser": adam_state(trained)}
    expected = {"step": 0, "model": {"a": torch.zeros(2)}, "optimiser": fresh}
    assert difference(content, expected, "checkpoint") is None
    assert difference(content | {"optimiser": adam_state(fresh)}, expected, "checkpoint") is None


def test_an_optimiser_stays_fused_or_not_when_it_is_restored():
    trained, content = adam(2)[0], adam_state(adam(3)[0])
    for group in trained.param_groups:
        group["fused"] = True
    restore_adam(trained, content)
    assert [group["fused"] for group in trained.param_groups] == [True]
    assert float(trained.state_dict()["state"][0]["step"]) == 3.0


def within(content: Any, *keys: Any, value: Any) -> None:
    for key in keys[:-1]:
        content = content[key]
    content[keys[-1]] = value


CHANGES: dict[str, tuple[Callable[[dict], object], str]] = {
    "none": (lambda c: c.update(model=None), r"None in place of a dict as checkpoint\['model'\]"),
    "text": (lambda c: c.update(step="3"), r"'3' in place of a int as checkpoint\['step'\]"),
    "missing": (lambda c: c.pop("step"), "no 'step' in checkpoint"),
    "surplus": (lambda c: c.update(more=1), "a surplus 'more' in checkpoint"),
    "list": (lambda c: within(c, "model", "a", value=[0.0, 0.0]), r"\[0.0, 0.0\] in place of torch.float32 \(2,\)"),
    "shape": (lambda c: within(c, "model", "a", value=torch.ones(3)), r"torch.float32 \(3,\) in place of"),
    "type": (lambda c: within(c, "model", "a", value=torch.ones(2).long()), r"torch.int64 \(2,\) in place of"),
    "no moments": (lambda c: within(c, "optimiser", "state", 0, value=None), "None in place of a dict"),
    "moment": (lambda c: within(c, "optimiser", "state", 0, "exp_avg", value=None), "None in place of torch.float32"),
    "stranger": (lambda c: within(c, "optimiser", "state", 7, value={}), r"a surplus 7 in checkpoint\['optimiser'\]"),
    "groups": (lambda c: within(c, "optimiser", "param_groups", value=[]), "no 0 in checkpoint"),
    "rate": (lambda c: within(c, "optimiser", "param_groups", 0, "rate", value="fast"), "'fast' in place of a float"),
    "numbers": (lambda c: within(c, "optimiser", "param_groups", 0, "params", value=[0]), "no 1 in checkpoint"),
    "state": (lambda c: within(c, "optimiser", "state", value=[]), r"\[\] in place of a dict"),
    "optimiser": (lambda c: c.update(optimiser=3), "3 in place of a dict"),
}


@pytest.mark.parametrize("name", sorted(CHANGES))
def test_differences_are_named(name):
    change, message = CHANGES[name]
    content = {"step": 3, "model": {"a": torch.ones(2)}, "optimiser": adam_state(adam(1)[0])}
    change(content)
    expected = {"step": 0, "model": {"a": torch.ones(2)}, "optimiser": adam(0)[0]}
    found = difference(content, expected, "checkpoint")
    assert found is not None
    assert re.search(message, found)


def test_what_is_no_dictionary():
    for content in (None, [], 3, torch.ones(2), "text"):
        assert difference(content, {"step": 0}, "checkpoint") is not None
