"""How threads that have nothing to do wait for work."""

import os
import sys

SPINS = 2000
"""Turns of its waiting loop, about a tenth of a millisecond, after which an idle thread sleeps."""
CHOICES = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Environment variables by which users choose for themselves."""


def sleep_when_idle() -> bool:
    """Let torch's idle threads sleep soon; call it in programs, before torch is loaded.

    By default they keep a processor busy for milliseconds after each parallel loop. On a machine with other work they
    take it from the thread that they wait for (docs/experiments/speed.md has the cost).

    Returns:
        Whether this takes effect: not once torch is loaded, and not where the user has chosen.
    """
    if "torch" in sys.modules or any(name in os.environ for name in CHOICES):
        return False
    os.environ["GOMP_SPINCOUNT"] = str(SPINS)
    return True
