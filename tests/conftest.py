"""Fixtures that every test may use."""

import gc
import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest
import torch
from frame_room import with_frame_room
from shape_checks import check_package

check_package("neural_strands")

WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_configure() -> None:
    """Let Ctrl-C through, and divide the processors among the workers.

    A shell lets its background jobs ignore Ctrl-C, which the programs that tests start would inherit. Threads of
    several workers on one processor would wait for each other at every barrier.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if WORKERS > 1:
        threads = max(1, (os.cpu_count() or 1) // WORKERS)
        torch.set_num_threads(threads)
        os.environ["OMP_NUM_THREADS"] = str(threads)  # for the programs that tests start


def pytest_collection(session: pytest.Session) -> bool:
    """Collect with room for frames and without the garbage collector.

    This imports the package, with a checker for each of its functions, and all of that stays in memory.
    """
    gc.disable()
    try:
        with_frame_room(session.perform_collect)
        gc.freeze()
    finally:
        gc.enable()
    return True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files of the longest tests: one that begins last would end alone."""
    longest: dict[Path, float] = {}
    for item in items:
        for mark in item.iter_markers("slow"):
            longest[item.path] = max(longest.get(item.path, 0.0), mark.kwargs.get("seconds", 10.0))
    items.sort(key=lambda item: -longest.get(item.path, 0.0))


@pytest.fixture(params=["cpu", "emulated", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request: pytest.FixtureRequest) -> torch.device:
    """Each device on which a test should pass."""
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


@pytest.fixture
def shapes_unchecked(monkeypatch: pytest.MonkeyPatch) -> None:
    """No checks of shapes and types at calls, which take much of a tiny fit's time.

    For long fits, and for what a command leaves, keeps and refuses: other tests of the same code check the shapes.
    """
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.fixture(scope="session")
def made_workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a small capture, its line segments and a short run, for tests that only read it."""
    from workspace import write_workspace

    folder = tmp_path_factory.mktemp("workspace")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEURAL_STRANDS_WEIGHTS", str(folder / "none"))
        write_workspace(folder)
    return folder


@pytest.fixture
def workspace(made_workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that folder, as the working folder."""
    folder = tmp_path / "workspace"
    shutil.copytree(made_workspace, folder)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(folder / "none"))
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of grooms, heads and captures beside the checkout; tests that need it skip without it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("shared/data is not beside the checkout")
    return SHARED_DATA
