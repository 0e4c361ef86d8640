"""Warp kernels over torch tensors: the same values as torch, in one piece or split."""

# Python's type checkers do not understand Warp's array types.
# pyright: reportIndexIssue=false, reportOperatorIssue=false

import functools
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import torch
import warp as wp

from neural_strands.foundation import kernels
from neural_strands.foundation.kernels import SMALLEST_SHARE, array, launch, launch_split, on_torch_stream, run_together


@wp.kernel
def _double(values: wp.array[wp.float32], result: wp.array[wp.float32]):
    index = wp.tid()
    result[index] = 2.0 * values[index]


@wp.kernel
def _square(start: int, values: wp.array[wp.float32], result: wp.array[wp.float32]):
    index = start + wp.tid()
    result[index] = values[index] * values[index]


def test_launch_fills_the_tensor(device: torch.device, generator: torch.Generator):
    values = torch.rand(100, generator=generator).to(device)
    result = torch.zeros_like(values)
    launch(_double, 100, [array(values), array(result)], device)
    assert torch.equal(result, 2 * values)


def test_launch_of_nothing_is_nothing(device: torch.device):
    launch(_double, 0, [], device)


@pytest.mark.parametrize("count", [1, SMALLEST_SHARE - 1, 5 * SMALLEST_SHARE + 3])
def test_split_launch_covers_every_item(count: int, device: torch.device, generator: torch.Generator):
    values = torch.rand(count, generator=generator).to(device)
    result = torch.full_like(values, -1.0)
    launch_split(_square, count, [array(values), array(result)], device)
    assert torch.equal(result, values * values)


def test_trees_and_grids_are_built_on_torchs_stream(monkeypatch: pytest.MonkeyPatch):
    order = []

    class Scope:
        def __init__(self, stream, sync_enter):
            order.append((stream, sync_enter))

        def __enter__(self):
            order.append("in")

        def __exit__(self, *_):
            order.append("out")

    monkeypatch.setattr(torch.cuda, "current_stream", lambda device: f"current of {device}")
    monkeypatch.setattr(wp, "stream_from_torch", lambda stream: f"as Warp's: {stream}")
    monkeypatch.setattr(wp, "ScopedStream", Scope)
    with on_torch_stream("cpu"):
        assert order == []
    with on_torch_stream(torch.device("cuda", 1)):
        order.append("built")
    assert order == [("as Warp's: current of cuda:1", False), "in", "built", "out"]


def test_array_shares_memory_and_drops_gradients():
    values = torch.arange(3.0).requires_grad_()
    shared = array(values)
    with torch.no_grad():
        values[1] = 7.0
    assert shared.numpy().tolist() == [0.0, 7.0, 2.0]
    assert not shared.requires_grad


def test_jobs_run_once_each_and_their_errors_arrive():
    ran = []

    def fail():
        ran.append(-1)
        raise ValueError("a job's own error")

    run_together([functools.partial(ran.append, k) for k in range(5)])
    assert sorted(ran) == [0, 1, 2, 3, 4]
    for jobs in ([fail, lambda: None], [lambda: None, fail]):
        with pytest.raises(ValueError, match="a job's own error"):
            run_together(jobs)
    assert ran.count(-1) == 2


def test_threads_are_kept_for_the_next_jobs():
    together = threading.Barrier(3)

    def name_thread() -> None:
        together.wait(60)
        names.append(threading.get_ident())

    runs = []
    for _ in range(2):
        names: list[int] = []
        run_together([name_thread] * 3)
        runs.append(set(names))
    assert len(runs[0]) == 3
    assert runs[0] == runs[1]


def test_threads_start_warp_one_after_the_other(monkeypatch):
    # Each would otherwise silence standard error while another one restores it.
    inside, most = [], []

    @functools.cache
    def slow_start():
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.05)
        inside.pop()

    monkeypatch.setattr(kernels, "_start_warp", slow_start)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: kernels.start_warp(), range(4)))
    assert most == [1]
