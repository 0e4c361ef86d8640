"""torchrun's processes take one GPU each."""

import pytest
import torch

from neural_strands.cli.device import pick_device
from neural_strands.foundation.errors import InputError


@pytest.fixture
def two_gpus(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A machine with two GPUs; which of them was made the current one."""
    chosen: list[int] = []
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)
    monkeypatch.setattr(torch.cuda, "set_device", chosen.append)
    return chosen


@pytest.mark.parametrize(("rank", "number"), [(None, 0), ("0", 0), ("1", 1)])
def test_each_process_takes_its_own(rank, number, two_gpus, monkeypatch):
    monkeypatch.delenv("LOCAL_RANK", raising=False)
    if rank is not None:
        monkeypatch.setenv("LOCAL_RANK", rank)
    assert pick_device("auto") == torch.device("cuda", number)
    assert pick_device("cuda") == torch.device("cuda", number)
    assert two_gpus == [number, number]
    assert pick_device("cpu") == torch.device("cpu")


def test_more_processes_than_gpus_are_refused(two_gpus, monkeypatch):
    monkeypatch.setenv("LOCAL_RANK", "2")
    with pytest.raises(InputError, match="at most 2 processes"):
        pick_device("cuda")
