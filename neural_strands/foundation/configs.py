"""Config dataclasses from JSON: every field is checked for its type and, where it sizes something, for its bounds."""

import dataclasses
import math
import types
import typing
from dataclasses import dataclass
from typing import Any, TypeVar

from neural_strands.foundation.json_files import JsonValue

LONGEST_TUPLE = 64
"""Most elements of a tuple that declares no bounds of its own."""

C = TypeVar("C")


@dataclass(frozen=True)
class Between:
    """Bounds of a number in a config, both included, or of the length of a tuple: `Annotated[int, Between(1, 64)]`.

    Attributes:
        low: least value.
        high: largest value.
    """

    low: float | int
    high: float | int


ANY_INTEGER = Between(-(2**63), 2**63 - 1)
"""What a whole number may be that declares no bounds."""
ANY_FLOAT = Between(-math.inf, math.inf)
"""What a float may be that declares no bounds; it is finite in any case."""


def config_from_json(kind: type[C], written: JsonValue) -> C:
    """Rebuild a config dataclass, nested ones included, from `dataclasses.asdict` after a round trip through JSON.

    A field that the document does not have takes its default.

    Args:
        kind: the dataclass; its fields are booleans, numbers, texts, literals, tuples, dataclasses, or one of these or
            None.
        written: the document or a part of it.

    Raises:
        InputError: a field that the dataclass does not have, or a value of another type or beyond its bounds.
    """
    hints = typing.get_type_hints(kind, include_extras=True)
    members = written.members()
    for name, member in members.items():
        if name not in hints:
            raise member.refuse(f"a setting that {kind.__name__} has")
    values = {name: _value(hints[name], member) for name, member in members.items()}
    try:
        return kind(**values)
    except (TypeError, ValueError) as error:
        raise written.refuse(f"settings that {kind.__name__} takes ({error})") from error


def _value(hint: Any, written: JsonValue, bounds: Between | None = None) -> Any:
    """Take a value of the type that a field declares."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        declared = next((extra for extra in arguments[1:] if isinstance(extra, Between)), bounds)
        return _value(arguments[0], written, declared)
    if origin in (typing.Union, types.UnionType):
        if written.value is None and type(None) in arguments:
            return None
        (hint,) = (argument for argument in arguments if argument is not type(None))
        return _value(hint, written, bounds)
    if origin is typing.Literal:
        return written.choice(arguments)
    if origin is tuple:
        return _tuple(arguments, written, bounds)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return config_from_json(hint, written)
    if hint is bool:
        return written.flag()
    if hint is str:
        return written.text()
    if hint is int:
        limits = bounds or ANY_INTEGER
        return written.whole(int(limits.low), int(limits.high))
    if hint is float:
        limits = bounds or ANY_FLOAT
        return written.number(float(limits.low), float(limits.high))
    raise TypeError(f"no value of type {hint} can be taken from JSON")


def _tuple(hints: tuple[Any, ...], written: JsonValue, bounds: Between | None) -> tuple[Any, ...]:
    elements = written.elements()
    if len(hints) == 2 and hints[1] is Ellipsis:
        limits = bounds or Between(0, LONGEST_TUPLE)
        if not limits.low <= len(elements) <= limits.high:
            raise written.refuse(f"a list of {limits.low} to {limits.high} elements")
        hints = (hints[0],) * len(elements)
    elif len(hints) != len(elements):
        raise written.refuse(f"a list of {len(hints)} elements")
    return tuple(_value(hint, element) for hint, element in zip(hints, elements, strict=True))
