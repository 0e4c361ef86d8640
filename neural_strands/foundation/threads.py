"""How idle threads wait for work."""

import os
import sys

SPINS = 2000
"""Iterations of the waiting loop, about a tenth of a millisecond, after which an idle thread sleeps."""
CHOICES = ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")
"""Environment variables with which users override this."""


def sleep_when_idle() -> bool:
    """Let torch's idle threads sleep soon; call it in programs, before torch is loaded.

    By default they keep a core busy for milliseconds after each parallel loop. On a busy machine they take it from the
    very thread that they wait for (docs/experiments/speed.md has the cost).

    Returns:
        Whether this takes effect; it does not if torch is already loaded or the user has set one of `CHOICES`.
    """
    if "torch" in sys.modules or any(name in os.environ for name in CHOICES):
        return False
    os.environ["GOMP_SPINCOUNT"] = str(SPINS)
    return True
