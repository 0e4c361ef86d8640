"""The same seed on the same machine gives the same bits on the CPU, with several threads, too."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import jaxtyping
import pytest
import torch
from order_of_sums import UnorderedSums
from whole_line import THREADS, digests, use_threads, work, write_given

PROGRAM = Path(__file__).with_name("support") / "whole_line.py"


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[UnorderedSums, dict[str, str]]:
    """Sums whose order threads decided while this process did all the work, and the digests of the results."""
    out, threads, sums = tmp_path_factory.mktemp("watched"), torch.get_num_threads(), UnorderedSums()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEURAL_STRANDS_WEIGHTS", str(out / "none"))
        patch.setattr(jaxtyping.config, "jaxtyping_disable", True)
        given = write_given(out / "given")
        use_threads(THREADS)
        try:
            with sums:
                work(out / "work", given)
        finally:
            use_threads(threads)
    return sums, digests(out / "work")


@pytest.mark.slow(seconds=100)
def test_no_order_of_a_sum_is_left_to_threads(watched: tuple[UnorderedSums, dict[str, str]]):
    assert watched[0].found == []


@pytest.mark.slow(seconds=100)
def test_everything_repeats_in_one_process_and_in_another(
    watched: tuple[UnorderedSums, dict[str, str]], tmp_path: Path
):
    found = watched[1]
    words = [sys.executable, str(PROGRAM), str(tmp_path / "out"), "2"]
    done = subprocess.run(words, env={**os.environ, "PYTHONHASHSEED": "7"}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, again = map(json.loads, done.stdout.splitlines())
    assert {"stereo/segments.npz", "run/model/model.safetensors", "simulated.usd", "prior.safetensors"} <= set(first)
    assert {name.partition("/")[0] for name in first} >= {"prepared", "evaluated", "turntable", "curled", "moved"}
    assert again == first
    assert found == first


@pytest.mark.parametrize(
    ("gathered", "is_unordered"),
    [
        (lambda values: values[torch.tensor([0, 2, 2])], True),
        (lambda values: values[torch.tensor([0, 2]), torch.tensor([1, 0])], False),
        (lambda values: values[torch.tensor([True, False, True])], False),
        (lambda values: values.index_select(0, torch.tensor([0, 2, 2])), False),
    ],
)
def test_such_sums_are_found(gathered: Callable[[torch.Tensor], torch.Tensor], is_unordered: bool):
    values = torch.ones(3, 2, requires_grad=True)
    with UnorderedSums() as sums:
        gathered(values).sum().backward()
    assert bool(sums.found) == is_unordered
