"""A second device made of CPU tensors: it refuses what CUDA refuses, so that a machine without one finds the mix-ups.

A `DeviceTensor` says that it lies on `cuda:0`, holds a CPU tensor, and computes with that. Operations that meet
tensors of both devices, draw on the device from a CPU generator, or hand a device tensor to NumPy raise as on CUDA.
Warp kernels run on the CPU, over arrays that know which device they came from. What it cannot show: what CUDA itself
computes, how fast, and in which order.

To torch's C++ a `DeviceTensor` is a CPU tensor, because a CPU build has no autograd for another device; only Python
sees the device. So whatever names a device passes through `_Devices`, and every operation through `run`.
"""

# Tensors, functions and arrays get attributes that their classes do not declare.
# pyright: reportAttributeAccessIssue=false, reportIncompatibleVariableOverride=false, reportArgumentType=false
# pyright: reportAssignmentType=false

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any
from unittest import mock

import torch
import warp as wp
from torch import Tensor
from torch.nn.utils import clip_grad
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import return_and_correct_aliasing
from torch.utils._pytree import tree_flatten, tree_map_only

from neural_strands.foundation import kernels

CUDA, CPU = torch.device("cuda", 0), torch.device("cpu")
aten = torch.ops.aten

INDEXING = {aten.index.Tensor, aten.index_put.default, aten.index_put_.default, aten._index_put_impl_.default}
"""The indices of these operations may be on the CPU while the data are on the device."""
NO_SCALARS = {
    aten.cat.default,
    aten.stack.default,
    aten.mm.default,
    aten.bmm.default,
    aten.addmm.default,
    aten.convolution.default,
    aten.index_select.default,
    aten.gather.default,
    aten.scatter.src,
    aten.scatter_.src,
    aten.scatter_add.default,
    aten.index_add.default,
    aten.index_copy.default,
    aten.embedding.default,
}
"""These refuse even a CPU tensor without dimensions, which other operations treat as a number."""
WAITS = {
    aten._local_scalar_dense.default,
    aten.nonzero.default,
    aten.masked_select.default,
    aten._unique2.default,
    aten.unique_dim.default,
    aten.unique_consecutive.default,
    aten.bincount.default,
    aten.repeat_interleave.Tensor,
    aten._linalg_check_errors.default,
    aten.equal.default,
    aten.is_nonzero.default,
}
"""The host waits for the device until these are done."""

waits: Counter[str] = Counter()
"""How often the host waited for the device, by operation."""
operations: Counter[str] = Counter()
"""How many operations ran on the device, by name."""


class DeviceTensor(Tensor):
    """A tensor on the emulated device."""

    __torch_function__ = torch._C._disabled_torch_function_impl
    held: Tensor

    @staticmethod
    def __new__(cls, held: Tensor) -> "DeviceTensor":
        made = Tensor._make_wrapper_subclass(
            cls,
            held.shape,
            strides=held.stride(),
            storage_offset=held.storage_offset(),
            dtype=held.dtype,
            layout=held.layout,
            device=CPU,
        )
        made.held = held
        return made

    def __init__(self, held: Tensor) -> None:
        pass

    @property
    def device(self) -> torch.device:
        return CUDA

    @property
    def is_cuda(self) -> bool:
        return True

    @property
    def is_cpu(self) -> bool:
        return False

    def __repr__(self, **kwargs: Any) -> str:
        return f"DeviceTensor({self.held!r})"

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Saved like plain tensors; `load` of this module moves it to `map_location`."""
        return self.held.detach().__reduce_ex__(protocol)

    @classmethod
    def __torch_dispatch__(cls, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return run(func, args, kwargs or {})


def on_device(value: Any) -> bool:
    return isinstance(value, DeviceTensor)


def run(func: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """One operation on a device tensor: devices are checked, the CPU computes, and the result is wrapped again."""
    if func is aten._has_compatible_shallow_copy_type.default:
        return False
    _check(func, args, kwargs)
    _count(func, args)
    plain_args, plain_kwargs = tree_map_only(DeviceTensor, lambda value: value.held, (args, kwargs))
    result = func(*plain_args, **plain_kwargs)
    if func is aten.copy_.default:
        return args[0]
    result = tree_map_only(Tensor, DeviceTensor, result)
    return return_and_correct_aliasing(func, args, kwargs, result)


def _check(func: Any, args: Any, kwargs: dict[str, Any]) -> None:
    """Refuse what CUDA refuses."""
    flat = tree_flatten((args, kwargs))[0]
    generator = next((value for value in flat if isinstance(value, torch.Generator)), None)
    if generator is not None and generator.device.type == "cpu":
        raise RuntimeError(f"{func}: Expected a 'cuda' device type for generator but found 'cpu'")
    if func is aten.copy_.default:
        return
    data = [args[0], *args[2:3]] if func in INDEXING else flat
    strangers = [value for value in data if isinstance(value, Tensor) and not on_device(value)]
    if any(value.dim() > 0 or func in NO_SCALARS for value in strangers):
        raise RuntimeError(
            f"{func}: Expected all tensors to be on the same device, but found at least two devices, cuda:0 and cpu!"
        )


def _count(func: Any, args: Any) -> None:
    operations[str(func)] += 1
    masks = [index for index in args[1] if isinstance(index, Tensor)] if func in INDEXING else []
    if func in WAITS:
        waits[str(func)] += 1
    elif any(index.dtype == torch.bool for index in masks):
        waits[f"{func} by a mask"] += 1
    elif any(not on_device(index) for index in masks):
        waits[f"{func} by an index on the CPU"] += 1
    elif func is aten.copy_.default and on_device(args[0]) != on_device(args[1]):
        # A copy goes on while the host does if it is asked to, and if the host's memory is pinned.
        host = args[1] if on_device(args[0]) else args[0]
        if not (any(args[2:]) and getattr(host, "pinned", False)):
            waits["copy_ between devices"] += 1


def pin_memory(tensor: Tensor) -> Tensor:
    """A copy that says that it is pinned."""
    pinned = tensor.clone()
    pinned.pinned = True
    return pinned


class _Move(torch.autograd.Function):
    """A copy to the other device that passes gradients back."""

    @staticmethod
    def forward(ctx: Any, tensor: Tensor) -> Tensor:
        return tensor.held.clone() if on_device(tensor) else DeviceTensor(tensor.detach().clone())

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        return moved(gradient, not on_device(gradient))


def moved(tensor: Tensor, to_device: bool, non_blocking: bool = False) -> Tensor:
    """The tensor on one device, itself if it is there already."""
    if on_device(tensor) == to_device:
        return tensor
    # To the CPU, torch takes pinned memory itself.
    if not (non_blocking and (getattr(tensor, "pinned", False) or not to_device)):
        waits["to the device" if to_device else "to the CPU"] += 1
    return _Move.apply(tensor)


class _Devices(TorchFunctionMode):
    """Handles every call that names a device or allocates memory."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        name = getattr(func, "__name__", "")
        first = args[0] if args else None
        if on_device(first) and name in ("numpy", "__array__", "data_ptr"):
            raise TypeError("can't convert cuda:0 device type tensor to numpy. Use Tensor.cpu() to copy it first.")
        if on_device(first) and name == "tolist":
            waits["tolist"] += 1
            return first.held.tolist()
        if func is Tensor.to:
            return _to(*args, **kwargs)
        if func is Tensor.cpu:
            return moved(first, False)
        if func is Tensor.type_as:
            return _to(*args)
        target, _ = kwargs.pop("device", None), kwargs.pop("pin_memory", None)
        if func is Tensor.__setitem__ and on_device(first) and isinstance(args[2], int | float):
            # A number becomes a tensor on the device, where it is filled in without the host.
            args = (first, args[1], DeviceTensor(torch.tensor(args[2], dtype=first.dtype)))
        if func is Tensor.new_tensor:
            made = torch.tensor(*args[1:], **{"dtype": first.dtype, **kwargs})
            return moved(made, on_device(first) if target is None else torch.device(target).type == "cuda")
        result = func(*args, **kwargs)
        if target is None:
            return result
        if isinstance(kwargs.get("generator"), torch.Generator) and torch.device(target).type == "cuda":
            raise RuntimeError(f"{name}: Expected a 'cuda' device type for generator but found 'cpu'")
        if func in (torch.tensor, torch.as_tensor, torch.asarray):
            return moved(result, torch.device(target).type == "cuda")
        if torch.device(target).type == "cuda":
            operations[name] += 1
            return result if on_device(result) else DeviceTensor(result.detach()).requires_grad_(result.requires_grad)
        return result.held if on_device(result) else result


def _to(tensor: Tensor, *args: Any, **kwargs: Any) -> Tensor:
    """`Tensor.to` with a device, a dtype, both, or another tensor's."""
    non_blocking = kwargs.pop("non_blocking", False)
    other = next((value for value in args if isinstance(value, Tensor)), kwargs.pop("other", None))
    if other is not None:
        args = (other.device, other.dtype)
    device = next((value for value in args if isinstance(value, torch.device | str)), kwargs.pop("device", None))
    dtype = next((value for value in args if isinstance(value, torch.dtype)), kwargs.pop("dtype", None))
    kwargs = {name: value for name, value in kwargs.items() if value is not None}
    result = tensor if dtype is None else tensor.to(dtype, **kwargs)
    if dtype is None and kwargs:
        result = tensor.to(tensor.dtype, **kwargs)
    return result if device is None else moved(result, torch.device(device).type == "cuda", non_blocking)


def grouped(tensors: list[list[Tensor]], *_: Any) -> dict[tuple[torch.device, torch.dtype], Any]:
    """Like torch's function, in C++, which would find these tensors on the CPU; for tensors of one kind."""
    return {(tensors[0][0].device, tensors[0][0].dtype): (tensors, list(range(len(tensors[0]))))}


def from_torch(tensor: Tensor, *args: Any, **kwargs: Any) -> wp.array:
    """Warp's view of a tensor, remembering the device."""
    made = _from_torch(tensor.held if on_device(tensor) else tensor, *args, **kwargs)
    made.emulated = on_device(tensor)
    return made


def launch(kernel: Any, dim: Any, inputs: Any, device: Any, stream: Any = None) -> None:
    """A launch on the CPU, refused if an array is on another device."""
    here = device is _WARP_DEVICE
    for value in inputs:
        if isinstance(value, wp.array) and value.emulated != here:
            found, wanted = ("cuda:0", "cpu") if value.emulated else ("cpu", "cuda:0")
            raise RuntimeError(f"{kernel.key}: an array on {found}, launched on {wanted}")
    if here and stream is not _WARP_STREAM:
        raise RuntimeError(f"{kernel.key}: launched on another stream than torch's")
    operations[f"warp {kernel.key}"] += here
    middle = dim // 2 if here and kernel.adj.args[0].label.startswith(("start", "first")) else 0
    if middle:
        # Kernels that may be split must not depend on the order of their items, because CUDA has none.
        _launch(kernel, dim=dim - middle, inputs=[middle, *inputs[1:]], device="cpu")
        inputs, dim = [0, *inputs[1:]], middle
    _launch(kernel, dim=dim, inputs=inputs, device="cpu")


def device_from_torch(device: torch.device | str) -> Any:
    """Like Warp's function, which refuses a device without an index."""
    device = torch.device(device)
    if device.type == "cuda" and device.index is None:
        raise TypeError("list indices must be integers or slices, not NoneType")
    return _WARP_DEVICE if device.type == "cuda" else "cpu"


def load_module(kernel: Any, device: torch.device | str) -> None:
    """Compile for the CPU, where a launch on the emulated device runs."""
    if torch.device(device).type == "cuda":
        kernels._warp_device(torch.device(device))
    _load_module(kernel, "cpu")


def load(path: Any, map_location: Any = None, **kwargs: Any) -> Any:
    """`torch.load` that may go to the emulated device."""
    content = _load(path, map_location="cpu", **kwargs)
    return content if map_location is None else tree_map_only(Tensor, lambda value: value.to(map_location), content)


class _Event:
    """A place in the queue of a device that has done everything by the time."""

    def record(self) -> None:
        pass

    def synchronize(self) -> None:
        waits["an event"] += 1


class _HashGrid(wp.HashGrid):
    """A hash grid that may be asked for on the emulated device."""

    def __init__(self, *sizes: int, device: str) -> None:
        super().__init__(*sizes, device="cpu")


class _Autocast(torch.autocast):
    """Autocast of the device is that of the CPU: the same kind of operations in bfloat16."""

    def __init__(self, device_type: str, dtype: torch.dtype | None = None, enabled: bool = True) -> None:
        super().__init__("cpu", dtype, enabled)


def _run_backward(*args: Any, **kwargs: Any) -> Any:
    """Backward passes written in Python see the device, as forward passes do."""
    with _Devices():
        return _real_run_backward(*args, **kwargs)


def _submit(pool: ThreadPoolExecutor, job: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
    """Threads see the device too."""

    def inside() -> Any:
        with _Devices():
            return job(*args, **kwargs)

    return _real_submit(pool, inside)


@contextlib.contextmanager
def emulated_cuda() -> Iterator[torch.device]:
    """Everything inside sees a CUDA device; the counts of `waits` and `operations` start again."""
    kernels.start_warp()
    waits.clear()
    operations.clear()
    stream = SimpleNamespace(cuda_stream=0, device=CUDA)
    replaced: list[tuple[Any, str, Any]] = [
        (torch.cuda, "is_available", lambda: True),
        (torch.cuda, "device_count", lambda: 1),
        (torch.cuda, "set_device", lambda *_: None),
        (torch.cuda, "current_device", lambda: 0),
        (torch.cuda, "current_stream", lambda *_: stream),
        (torch.cuda, "synchronize", lambda *_: None),
        (torch.cuda, "Event", _Event),
        (torch.cuda, "reset_peak_memory_stats", lambda *_: None),
        (torch.cuda, "max_memory_allocated", lambda *_: 0),
        # A parameter that is moved becomes a new one, because its memory cannot be replaced by that of a wrapper.
        (torch.__future__, "get_overwrite_module_params_on_conversion", lambda: True),
        (torch.autograd, "_engine_run_backward", _run_backward),
        (torch, "load", load),
        (torch, "autocast", _Autocast),
        # Wrappers do not support inference tensors.
        (torch, "inference_mode", torch.no_grad),
        (wp, "from_torch", from_torch),
        (wp, "launch", launch),
        (wp, "device_from_torch", device_from_torch),
        (wp, "stream_from_torch", lambda *_: _WARP_STREAM),
        (wp, "ScopedStream", lambda *_, **__: contextlib.nullcontext()),
        (wp, "HashGrid", _HashGrid),
        (Tensor, "pin_memory", pin_memory),
        (clip_grad, "_group_tensors_by_device_and_dtype", grouped),
        (kernels, "load", load_module),
        (ThreadPoolExecutor, "submit", _submit),
    ]
    with contextlib.ExitStack() as stack:
        for owner, name, value in replaced:
            stack.enter_context(mock.patch.object(owner, name, value))
        stack.enter_context(_Devices())
        yield torch.device("cuda")


_from_torch, _launch, _load, _load_module = wp.from_torch, wp.launch, torch.load, kernels.load
_real_run_backward = torch.autograd._engine_run_backward
_real_submit = ThreadPoolExecutor.submit
_WARP_DEVICE, _WARP_STREAM = object(), object()
