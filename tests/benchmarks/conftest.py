"""Access to modules of the benchmarks, which are programs rather than a package."""

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="session")
def benchmark_module() -> Iterator[Callable[[str, str], ModuleType]]:
    """A function that imports a module of a folder of `benchmarks/` by its name."""
    with pytest.MonkeyPatch.context() as patch:

        def load(folder: str, name: str) -> ModuleType:
            patch.syspath_prepend(str(BENCHMARKS / folder))
            return importlib.import_module(name)

        yield load
