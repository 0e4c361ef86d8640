"""A CUDA device without memory: torch works out devices and shapes of everything, and computes nothing.

Where the host would wait for the device, because a size or a number depends on data, it is counted, and a made-up
answer lets the trace go on: half of the elements are found, a number is the least that makes sense.
"""

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Any
from unittest import mock

import torch
from emulated_device import INDEXING, WAITS
from torch import Tensor, nn
from torch._subclasses.fake_tensor import FakeTensor, FakeTensorMode
from torch.nn import functional
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_map_only

aten = torch.ops.aten
NUMBER = 64
"""The answer to every question after a number."""


NUMBERS = {Tensor.item: lambda number: number, Tensor.__int__: int, Tensor.__float__: float, Tensor.__bool__: bool}
"""How Python asks a tensor for its number."""


class _Waits(TorchDispatchMode):
    """Counts what makes the host wait for the device, and answers it."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: Counter[str] = Counter()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        first = args[0] if args else None
        fake = isinstance(first, FakeTensor)
        if func in WAITS and fake and first.device.type == "cuda":
            self.counts[str(func)] += 1
        if func is aten._local_scalar_dense.default and fake:
            return bool(NUMBER) if first.dtype == torch.bool else NUMBER if not first.is_floating_point() else 0.5
        if func is aten.nonzero.default and fake:
            return _half_of(first)
        if func in INDEXING and any(_is_mask(index) for index in args[1]):
            self.counts[f"{func} by a mask"] += 1
            args = (first, [part for index in args[1] for part in _found(index)], *args[2:])
        if func is aten.copy_.default or func is aten._to_copy.default:
            source = args[1] if func is aten.copy_.default else first
            target = first.device if func is aten.copy_.default else kwargs.get("device", first.device)
            if isinstance(source, FakeTensor) and source.device.type == "cuda" and torch.device(target).type == "cpu":
                self.counts["to the CPU"] += 1
        return func(*args, **kwargs)


class _Methods(TorchFunctionMode):
    """Methods whose bindings in C++ ask for the CUDA that a CPU build does not have."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func is Tensor.contiguous and isinstance(args[0], FakeTensor):
            return args[0] if args[0].is_contiguous() else aten.clone(args[0], memory_format=torch.contiguous_format)
        if func is Tensor.new_tensor and isinstance(args[0], FakeTensor):
            return torch.tensor(args[1]).to(args[0].device, args[0].dtype)
        if func in NUMBERS and isinstance(args[0], FakeTensor):
            return NUMBERS[func](aten._local_scalar_dense(args[0]))
        if func is Tensor.tolist and isinstance(args[0], FakeTensor):
            return _listed(args[0])
        if func is Tensor.copy_ and isinstance(args[0], FakeTensor):
            return aten.copy_(*args[:2])
        if func is functional.grid_sample and isinstance(args[0], FakeTensor):
            # One kernel on a device; traced, it is taken apart into subscripts, which end in C++.
            return aten.new_empty(args[0], [*args[0].shape[:2], *args[1].shape[1:-1]])
        if func in (Tensor.nonzero, torch.nonzero) and isinstance(args[0], FakeTensor):
            return aten.nonzero(args[0])
        if func is Tensor.__getitem__ and isinstance(args[0], FakeTensor):
            view, indices = _viewed(*args)
            return view if indices is None else aten.index.Tensor(view, indices)
        if func is Tensor.__setitem__ and isinstance(args[0], FakeTensor):
            view, indices = _viewed(args[0], args[1])
            value = args[2] if isinstance(args[2], Tensor) else view.new_full((), args[2])
            if indices is None:
                aten.copy_(view, value)
            else:
                aten.index_put_.default(view, indices, value)
            return None
        return func(*args, **(kwargs or {}))


def _listed(tensor: Tensor) -> Any:
    return [_listed(row) for row in tensor.unbind()] if tensor.dim() else tensor.item()


def _viewed(tensor: Tensor, index: Any) -> tuple[Tensor, list[Tensor | None] | None]:
    """The view that numbers, slices and new axes of a subscript make, and its indices by tensors, if there are any."""
    parts = list(index) if isinstance(index, tuple) else [index]
    parts = [torch.tensor(part) if isinstance(part, list) else part for part in parts]
    taken = sum(part.dim() if _is_mask(part) else 1 for part in parts if part is not None and part is not Ellipsis)
    fill = [slice(None)] * (tensor.dim() - taken)
    if any(part is Ellipsis for part in parts):
        at = next(k for k, part in enumerate(parts) if part is Ellipsis)
        parts[at : at + 1] = fill
    indices: list[Tensor | None] = []
    for part in parts:
        place = len(indices)
        if part is None:
            tensor = tensor.unsqueeze(place)
            indices.append(None)
        elif isinstance(part, slice):
            tensor = aten.slice.Tensor(tensor, place, part.start, part.stop, part.step or 1)
            indices.append(None)
        elif isinstance(part, Tensor):
            indices.append(part)
        else:
            tensor = tensor.select(place, int(part))
    return tensor, indices if any(each is not None for each in indices) else None


def _is_mask(part: Any) -> bool:
    return isinstance(part, Tensor) and part.dtype == torch.bool


def _found(index: Tensor | None) -> list[Tensor | None]:
    """Indices in the place of a mask, of which half are found; any other index as it is."""
    if index is None or not _is_mask(index):
        return [index]
    return list(_half_of(index).unbind(1))


def _half_of(tensor: Tensor) -> Tensor:
    """The answer to the question which elements are not zero."""
    return torch.zeros(tensor.numel() // 2, tensor.dim(), dtype=torch.int64, device=tensor.device)


@contextlib.contextmanager
def traced_cuda() -> Iterator[tuple[FakeTensorMode, Counter[str]]]:
    """Within the block `device="cuda"` is a device of shapes alone; yields the mode and the count of waits.

    Forward passes only: a CPU build of torch has no autograd for the device, and aborts.
    """
    # Without CUDA, autocast of the device only warns that it does nothing.
    still = mock.patch.object(torch, "autocast", return_value=contextlib.nullcontext())
    with still, torch.no_grad(), FakeTensorMode(allow_non_fake_inputs=True) as mode, _Waits() as waits, _Methods():
        yield mode, waits.counts


def on_traced_cuda(module: nn.Module, mode: FakeTensorMode) -> nn.Module:
    """A module with its parameters and buffers on that device; call it outside the block."""
    for part in module.modules():
        for name, value in part._parameters.items():
            if value is not None:
                part._parameters[name] = nn.Parameter(_moved(value, mode), value.requires_grad)
        for name, value in part._buffers.items():
            if value is not None:
                part._buffers[name] = _moved(value, mode)
    return module


def _moved(tensor: Tensor, mode: FakeTensorMode) -> Tensor:
    with mode:
        return torch.zeros(tensor.shape, dtype=tensor.dtype, device="cuda")


def devices(whole: Any) -> set[str]:
    """Kinds of device of all tensors in a structure."""
    found: set[str] = set()
    tree_map_only(Tensor, lambda tensor: found.add(tensor.device.type), whole)
    return found
