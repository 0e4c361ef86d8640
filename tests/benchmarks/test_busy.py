"""The fair share of the cores, compared with turns that all who want to run take, and the busy processes."""

from fractions import Fraction

import pytest


@pytest.fixture(scope="module")
def busy(benchmark_module):
    return benchmark_module("speed", "busy")


def seconds_by_turns(cores: int, busy: int, threads: int, work: int) -> Fraction:
    """Time until each of our threads has had `work` turns of a core, if those go next that have had the fewest."""
    had, ours, turns = [0] * (busy + threads), range(busy, busy + threads), 0
    while any(had[thread] < work for thread in ours):
        waiting = [one for one in range(len(had)) if one < busy or had[one] < work]
        for one in sorted(waiting, key=lambda one: had[one])[:cores]:
            had[one] += 1
        turns += 1
    return Fraction(turns, work)


@pytest.mark.parametrize("cores", [1, 2, 4])
@pytest.mark.parametrize("others", [0, 1, 2, 5])
@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_fair_time_is_that_of_taking_turns(busy, cores, others, threads):
    alone = seconds_by_turns(cores, 0, threads, 600)
    expected = seconds_by_turns(cores, others, threads, 600)
    assert busy.Load(cores, others, threads).fair_seconds(float(alone)) == pytest.approx(float(expected), rel=0.01)


def test_two_busy_processes_on_two_cores(busy):
    assert busy.Load(2, 2, 1).fair_seconds(1.0) == pytest.approx(1.5)
    assert busy.Load(2, 2, 2).fair_seconds(1.0) == pytest.approx(2.0)
    assert busy.Load(2, 0, 2).fair_seconds(1.0) == 1.0


def test_busy_processes_end_with_the_block(busy):
    with busy.busy_processes(2) as processes:
        assert [process.poll() for process in processes] == [None, None]
    assert all(process.returncode is not None for process in processes)


def test_the_table_has_the_ratio_to_the_fair_time(busy, monkeypatch):
    taken = iter([[0.1, 0.3, 0.2], [0.5, 0.5, 0.5], [0.2, 0.2, 0.2]])
    monkeypatch.setattr(busy, "works", lambda _: busy.contextlib.nullcontext({"a step": lambda: next(taken)}))
    monkeypatch.setattr(busy.os, "sched_getaffinity", lambda _: {0, 1})
    (row,) = busy.measured(busy.Arguments(busy=2, threads=(1,)))
    assert row[:2] == ("a step", 1)
    assert row[2:6] == pytest.approx((200.0, 200.0, 500.0, 300.0))
    assert row[6] == "1.67"
