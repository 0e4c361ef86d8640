"""Launches Warp kernels over torch tensors, on CPU and CUDA from one source.

Warp runs a kernel on one CPU thread. A kernel whose threads write only their own outputs may be split: it takes the
first index as its first argument (`start`) and adds it to `wp.tid()`. Kernels that use atomics must not be split.

When torch traces instead of computing (torch.compile, or tensors without memory on a device that does not exist),
launches become the operator `neural_strands::launch`, which torch can put into its graphs.
"""

import contextlib
import functools
import itertools
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensor

from neural_strands.foundation.errors import InputError, reason

Kernel = Any
"""A `wp.Kernel`, although Warp annotates its decorator as returning the plain function."""
SMALLEST_SHARE = 1024
"""Smallest number of items per thread; fewer are not worth another thread."""
_STARTING = threading.Lock()
"""Held while Warp starts: threads that silence standard error at the same time could leave it silent."""


def start_warp() -> None:
    """Initialise Warp once and log only errors, because Warp logs to standard output, where results belong."""
    with _STARTING:
        _start_warp()


@functools.cache
def _start_warp() -> None:
    wp.config.log_level = logging.ERROR
    with _silent_stderr() if not torch.cuda.is_available() else contextlib.nullcontext(), _writable_cache():
        wp.init()


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    """Suppress the message of Warp's native library that there is no NVIDIA driver."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def is_traced(tensor: Tensor) -> bool:
    """Whether torch only traces the work on a tensor, which then may have no values."""
    return isinstance(tensor, FakeTensor) or torch.compiler.is_compiling()


def array(tensor: Tensor, dtype: Any = None) -> Any:
    """View a tensor as a Warp array without a copy (made contiguous first); no gradient passes through.

    While torch traces, it stays a tensor until the operator runs.
    """
    flat = tensor.detach().contiguous()
    if is_traced(flat):
        return flat
    start_warp()
    return wp.from_torch(flat, dtype=dtype, requires_grad=False)


def zeros(shape: Sequence[int], dtype: torch.dtype, device: torch.device) -> Tensor:
    """Allocate zeros for kernels to write to; on the CPU without a parallel loop of torch.

    After such a loop torch's idle threads keep the cores busy for milliseconds, and the kernels need them.
    """
    if device.type == "cpu" and not torch.compiler.is_compiling():
        return torch.from_numpy(np.zeros(tuple(shape), torch.zeros(0, dtype=dtype).numpy().dtype))
    return torch.zeros(*shape, dtype=dtype, device=device)


def cpu_threads() -> int:
    """Number of threads between which a caller divides work; one while torch compiles, whose graphs would keep it."""
    return 1 if torch.compiler.is_compiling() else torch.get_num_threads()


@contextlib.contextmanager
def on_torch_stream(device: torch.device | str) -> Iterator[None]:
    """Make Warp build trees and grids on torch's current stream within the block; launches run there too.

    Warp's own stream and torch's default one wait for each other, but Warp's does not wait for other torch streams, and
    cannot be captured with them.
    """
    if torch.device(device).type != "cuda":
        yield
        return
    stream = wp.stream_from_torch(torch.cuda.current_stream(device))
    with wp.ScopedStream(stream, sync_enter=False):
        yield


def launch(kernel: Kernel, count: int, inputs: Sequence[Any], device: torch.device | str) -> None:
    """Run `kernel` for `count` items on one thread (CPU) or the current torch stream (CUDA)."""
    device = torch.device(device)
    if _are_traced(inputs):
        _launch_traced(kernel, count, inputs, split=False)
        return
    if count == 0:
        return
    if device.type == "cuda":
        stream = wp.stream_from_torch(torch.cuda.current_stream(device))
        with _writable_cache():
            wp.launch(kernel, dim=count, inputs=list(inputs), device=_warp_device(device), stream=stream)
        return
    with _writable_cache():
        wp.launch(kernel, dim=count, inputs=list(inputs), device="cpu")


def launch_split(kernel: Kernel, count: int, inputs: Sequence[Any], device: torch.device | str) -> None:
    """Run a kernel that takes `start` first, with its items split between torch's CPU threads."""
    device = torch.device(device)
    if _are_traced(inputs):
        _launch_traced(kernel, count, [0, *inputs], split=True)
        return
    shares = min(torch.get_num_threads(), count // SMALLEST_SHARE)
    if device.type == "cuda" or shares < 2:
        launch(kernel, count, [0, *inputs], device)
        return
    load(kernel, device)
    bounds = [count * share // shares for share in range(shares + 1)]
    run_together(
        [
            functools.partial(wp.launch, kernel, dim=last - first, inputs=[first, *inputs], device="cpu")
            for first, last in itertools.pairwise(bounds)
        ]
    )


def run_together(jobs: Sequence[Callable[[], object]]) -> None:
    """Run jobs that release the interpreter's lock (kernel launches), each on its own thread if possible.

    The caller's thread runs the first job, and then those that no other thread has started: on a busy machine a thread
    may wait longer for a core than its job takes.
    """
    if len(jobs) == 1:
        jobs[0]()
        return
    helpers = _helpers(len(jobs) - 1)
    others = [(job, helpers.submit(job)) for job in jobs[1:]]
    try:
        jobs[0]()
        for job, begun in others:
            if begun.cancel():
                job()
            else:
                begun.result()
    finally:
        for _, begun in others:
            begun.cancel()


@functools.cache
def _helpers(count: int) -> ThreadPoolExecutor:
    """Threads that are kept: starting them for each launch took much longer (docs/experiments/speed.md)."""
    return ThreadPoolExecutor(count, thread_name_prefix="kernels")


def load(kernel: Kernel, device: torch.device | str) -> None:
    """Compile and load a kernel's module now (cached between processes) rather than at its first launch.

    Raises:
        InputError: the compiled kernel cannot be written to Warp's cache.
    """
    device = torch.device(device)
    if torch.compiler.is_compiling() or (device.type == "cuda" and not torch.cuda.is_available()):
        # While torch traces, nothing is loaded: the operator loads the kernel when it runs.
        return
    start_warp()
    with _writable_cache():
        kernel.module.load("cpu" if device.type == "cpu" else _warp_device(device))


@contextlib.contextmanager
def _writable_cache() -> Iterator[None]:
    """Turn a full or read-only disk, to which a new kernel cannot be written, into an InputError."""
    try:
        yield
    except OSError as error:
        cache = error.filename or wp.config.kernel_cache_dir
        raise InputError(
            f"{cache}: expected to write compiled kernels here, found {reason(error)}; free some space or set "
            "WARP_CACHE_PATH to another folder"
        ) from error


def _warp_device(device: torch.device) -> Any:
    """Warp's name of a CUDA device. Warp needs an index; without one, torch's current device is used."""
    return wp.device_from_torch(torch.device("cuda", torch.cuda.current_device()) if device.index is None else device)


def _are_traced(inputs: Sequence[Any]) -> bool:
    return any(isinstance(value, Tensor) for value in inputs)


def _launch_traced(kernel: Kernel, count: int, inputs: Sequence[Any], split: bool) -> None:
    """Pass a launch to the operator, with arrays separate from numbers, and vectors, matrices and structs flattened."""
    arrays = [value for value in inputs if isinstance(value, Tensor)]
    numbers = [number for value in inputs if not isinstance(value, Tensor) for number in _numbers_of(value)]
    launch_operator(f"{kernel.module.name}.{kernel.key}", count, arrays, numbers, split)


def _numbers_of(value: Any) -> list[float | int]:
    """The numbers of a kernel's argument, in order."""
    if isinstance(value, int | float):
        return [value]
    if isinstance(value, tuple):
        return list(value)
    if hasattr(value, "_cls"):
        return [number for name in value._cls.vars for number in _numbers_of(getattr(value, name))]
    return np.array(value).ravel().tolist()


def _argument_of(kind: Any, numbers: Iterator[float | int]) -> Any:
    """The inverse of `_numbers_of` for an argument of this type, from the numbers that are left."""
    if hasattr(kind, "vars"):
        made = kind()
        for name, member in kind.vars.items():
            setattr(made, name, _argument_of(member.type, numbers))
        return made
    return kind(*itertools.islice(numbers, kind._length_)) if hasattr(kind, "_length_") else next(numbers)


@torch.library.custom_op(
    "neural_strands::launch",
    mutates_args=("arrays",),
    schema="(str kernel, SymInt count, Tensor(a!)[] arrays, Scalar[] numbers, bool split) -> ()",
)
def launch_operator(
    kernel: str, count: int, arrays: Sequence[Tensor], numbers: Sequence[float | int], split: bool
) -> None:
    """Launch a kernel by its name, with its arrays and the numbers between them in the order of its arguments."""
    module, _, key = kernel.rpartition(".")
    found: Kernel = wp.get_module(module).kernels[key]
    left_arrays, left_numbers, inputs = iter(arrays), iter(numbers), []
    for argument in found.adj.args:
        kind = argument.type
        is_array = hasattr(kind, "ndim")
        inputs.append(array(next(left_arrays), kind.dtype) if is_array else _argument_of(kind, left_numbers))
    if split:
        launch_split(found, count, inputs[1:], arrays[0].device)
    else:
        launch(found, count, inputs, arrays[0].device)


@launch_operator.register_fake
def _launch_fake(kernel: str, _: int, arrays: Sequence[Tensor], *__: object) -> None:
    """Fake version of the operator for tracing: computes nothing, but refuses what CUDA would refuse."""
    devices = {tensor.device for tensor in arrays}
    if len(devices) > 1:
        raise RuntimeError(f"{kernel}: expected all arrays on one device, found {', '.join(map(str, devices))}")
