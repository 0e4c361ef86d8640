"""Checks the shapes and types of arguments and results at every call of the package's functions.

jaxtyping's own wrapper binds the arguments of each call to its signature, and checks them before the call and once more
after it. Here beartype checks them once, in the function itself (docs/experiments/speed.md has the cost of both).
jaxtyping still keeps the sizes of named axes.
"""

import dataclasses
import functools
import inspect
import types
import typing
from collections.abc import Callable, Iterable
from typing import Any

import jaxtyping
from beartype import BeartypeConf, BeartypeStrategy, beartype
from beartype.roar import BeartypeCallHintViolation
from jaxtyping import AbstractArray
from jaxtyping._storage import pop_shape_memo, push_shape_memo, shape_str

CHECKED = beartype(conf=BeartypeConf(strategy=BeartypeStrategy.On))


def check_package(name: str) -> None:
    """Check each function of a package that is imported from now on."""
    jaxtyping.jaxtyped = _jaxtyped
    jaxtyping.install_import_hook(name, "shape_checks.checked")


def checked(target: Any) -> Any:
    """A function that checks its calls, or a dataclass that checks its values; other classes stay as they are."""
    if isinstance(target, classmethod | staticmethod):
        return type(target)(checked(target.__func__))
    if isinstance(target, property):
        accessors = (target.fget, target.fset, target.fdel)
        return property(*(each and checked(each) for each in accessors), doc=target.__doc__)
    if inspect.isclass(target):
        if dataclasses.is_dataclass(target) and not hasattr(target.__init__, "__wrapped__"):
            target.__init__ = _checked_function(target.__init__)
        return target
    return _checked_function(target)


def _jaxtyped(*, typechecker: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """What the import hook calls in place of `jaxtyping.jaxtyped`."""
    return typechecker


def _checked_function(function: Callable[..., Any]) -> Callable[..., Any]:
    by_beartype = CHECKED(_with_known_hints(function))
    arrays = [hint for hint in _parts(by_beartype.__annotations__.values()) if _is_array(hint)]
    # Sizes such as {count} are values of arguments.
    signature = inspect.signature(function) if any("{" in array.dim_str for array in arrays) else None

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        __tracebackhide__ = True
        if jaxtyping.config.jaxtyping_disable:
            return function(*arguments, **named)
        if not arrays:
            return by_beartype(*arguments, **named)
        values = {}
        if signature is not None:
            bound = signature.bind(*arguments, **named)
            bound.apply_defaults()
            values = bound.arguments
        sizes = push_shape_memo(values)
        try:
            return by_beartype(*arguments, **named)
        except BeartypeCallHintViolation as error:
            error.add_note(shape_str(sizes))
            raise
        finally:
            pop_shape_memo()

    return call


def _with_known_hints(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, or a copy in which hints that are strings are what they name, or anything if that is not known.

    A class is not known before its end; nor is what is imported for the type checker alone.
    """
    hints = dict(getattr(function, "__annotations__", {}))
    texts = {name: hint for name, hint in hints.items() if isinstance(hint, str)}
    if not texts:
        return function
    for name, text in texts.items():
        try:
            hints[name] = eval(text, function.__globals__)
        except (NameError, AttributeError, TypeError):
            hints[name] = Any
    copy = types.FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    )
    functools.update_wrapper(copy, function)
    copy.__kwdefaults__ = function.__kwdefaults__
    copy.__annotations__ = hints
    return copy


def _parts(hints: Iterable[Any]) -> list[Any]:
    """Hints, and the hints of which they are made."""
    return [part for hint in hints for part in (hint, *_parts(typing.get_args(hint)))]


def _is_array(hint: Any) -> bool:
    return inspect.isclass(hint) and issubclass(hint, AbstractArray)
