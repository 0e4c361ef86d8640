"""At some depths, every call takes a new page; with room for frames, none does at any depth."""

import sys

import pytest
from frame_room import with_frame_room

CALLS, DEPTH = 200, 400


def page_faults() -> int:
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def nothing() -> None:
    pass


def most_faults(depth: int = 0) -> int:
    """The most page faults of a loop of calls, of all depths."""
    before = page_faults()
    for _ in range(CALLS):
        nothing()
    here = page_faults() - before
    return here if depth == DEPTH else max(here, most_faults(depth + 1))


@pytest.mark.skipif(sys.platform != "linux", reason="counts the page faults of Linux")
def test_calls_take_no_new_pages():
    assert most_faults() >= CALLS
    assert with_frame_room(most_faults) < CALLS / 10


def test_results_are_passed_on():
    assert with_frame_room(lambda: 42) == 42
