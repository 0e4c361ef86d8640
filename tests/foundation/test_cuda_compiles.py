"""Every Warp kernel compiles for CUDA. No device is needed: NVRTC comes with Warp."""

import importlib
import os
import pkgutil
import sys
from pathlib import Path

import pytest
import warp as wp

import neural_strands
from neural_strands.foundation.kernels import start_warp

ARCHITECTURES = os.environ.get("NEURAL_STRANDS_CUDA_ARCHITECTURES", "90").split(",")
"""Those of H100 and H200 by default; 80 is that of A100, 120 that of consumer Blackwell cards."""


def modules_with_kernels() -> list[str]:
    """Modules of the package that define kernels, found in their source."""
    found = []
    for module in pkgutil.walk_packages(neural_strands.__path__, "neural_strands."):
        path = Path(*neural_strands.__path__, *module.name.split(".")[1:]).with_suffix(".py")
        if path.is_file() and "@wp.kernel" in path.read_text(encoding="utf-8"):
            found.append(module.name)
    return found


def test_the_search_finds_kernels():
    assert len(modules_with_kernels()) >= 10


@pytest.mark.skipif(sys.platform == "darwin", reason="Warp is built without CUDA for macOS")
@pytest.mark.parametrize("name", modules_with_kernels())
def test_kernels_compile_for_cuda(name: str, tmp_path: Path):
    start_warp()
    # The oldest compute capability that Warp compiles for; newer ones support everything that it does.
    oldest = min(wp.get_cuda_supported_archs())
    kernels = set(wp.get_module(importlib.import_module(name).__name__).kernels)
    artifacts = wp.compile_aot_module(name, arch=oldest, module_dir=tmp_path, use_ptx=True)
    code = artifacts[0].read_text()
    assert f".target sm_{oldest}" in code
    assert kernels
    missing = [kernel for kernel in kernels if not any(f".entry {kernel}" in line for line in code.splitlines())]
    assert missing == []


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "darwin", reason="Warp is built without CUDA for macOS")
@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_every_kernel_becomes_machine_code(arch: str, tmp_path: Path):
    start_warp()
    for name in modules_with_kernels():
        importlib.import_module(name)
        code = wp.compile_aot_module(name, arch=int(arch), module_dir=tmp_path / name, use_ptx=False)[0].read_bytes()
        assert code.startswith(b"\x7fELF"), name
