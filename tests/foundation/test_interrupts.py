"""Ctrl-C waits for the end of a block, and only there."""

import signal
import threading

import pytest

from neural_strands.foundation.interrupts import deferred_interrupt, whole_steps


def test_an_interrupt_waits_for_the_end_of_the_block():
    done = []

    def once():
        with deferred_interrupt():
            signal.raise_signal(signal.SIGINT)
            done.append("the rest")

    with pytest.raises(KeyboardInterrupt):
        once()
    assert done == ["the rest"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_does_not_wait():
    done = []

    def twice():
        with deferred_interrupt():
            signal.raise_signal(signal.SIGINT)
            done.append("some")
            signal.raise_signal(signal.SIGINT)
            done.append("the rest")

    with pytest.raises(KeyboardInterrupt):
        twice()
    assert done == ["some"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_error_within_the_block_comes_first():
    def fails():
        with deferred_interrupt():
            signal.raise_signal(signal.SIGINT)
            raise ValueError("wrong")

    with pytest.raises(ValueError, match="wrong"):
        fails()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_whoever_handled_the_signal_handles_it_then():
    seen = []
    signal.signal(signal.SIGINT, lambda number, _: seen.append(number))
    try:
        with deferred_interrupt():
            signal.raise_signal(signal.SIGINT)
            assert seen == []
        assert seen == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def test_an_ignored_signal_stays_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupt():
            signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def test_other_threads_are_left_alone():
    ran = []

    def work():
        with deferred_interrupt():
            ran.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert ran == [signal.default_int_handler]


def test_steps_are_taken_whole():
    reached = []

    def steps():
        for k in range(4):
            if k == 2:
                signal.raise_signal(signal.SIGINT)
            reached.append(k)
            yield k

    taken = []
    with pytest.raises(KeyboardInterrupt):
        taken.extend(whole_steps(steps()))
    assert reached == [0, 1, 2]
    assert list(whole_steps(iter("ab"))) == ["a", "b"]
