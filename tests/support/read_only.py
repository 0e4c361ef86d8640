"""A folder that nothing can be written to."""

import os
from pathlib import Path

import pytest


def read_only_folder(place: Path) -> Path:
    """A folder at `place` without permission to write; for the superuser, who needs none, one of the system's own."""
    if hasattr(os, "geteuid") and os.geteuid() != 0:
        place.mkdir()
        place.chmod(0o500)
        return place
    kernel = Path("/sys/kernel")
    if not kernel.is_dir():
        pytest.skip("no folder refuses the superuser")
    return kernel
