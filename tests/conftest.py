"""Fixtures that every test may use."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(params=["cpu", "emulated", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> torch.device:
    """Each device that a test should hold on."""
    return torch.device("cpu") if request.param == "cpu" else request.getfixturevalue(request.param)


@pytest.fixture
def emulated() -> Iterator[torch.device]:
    """A device that refuses what CUDA refuses and computes on the CPU."""
    from emulated_device import emulated_cuda

    with emulated_cuda() as device:
        yield device


@pytest.fixture
def cuda() -> torch.device:
    """A CUDA device; a test that needs one skips without it."""
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device")
    return torch.device("cuda")


@pytest.fixture
def generator() -> torch.Generator:
    """A fresh generator, the same in every run."""
    return torch.Generator().manual_seed(0)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of grooms, heads and captures beside the checkout; tests that need it skip without it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("shared/data is not beside the checkout")
    return SHARED_DATA
