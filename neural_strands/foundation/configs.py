"""Reads config dataclasses from JSON or TOML; every field is checked for its type and for its bounds, if it has any."""

import dataclasses
import difflib
import math
import tomllib
import types
import typing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, cast

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.input_files import read_text
from neural_strands.foundation.json_files import JsonValue, read_json

LONGEST_TUPLE = 64
"""Largest number of elements of a tuple without bounds of its own."""

LARGEST_FILE = 2**20
"""Largest file of settings, bytes."""

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
"""Bounds of an integer that declares none."""
ANY_FLOAT = Between(-math.inf, math.inf)
"""Bounds of a float that declares none; it must be finite in any case."""


def config_from_json(base: C | type[C], written: JsonValue) -> C:
    """Rebuild a config dataclass, nested ones included, from `dataclasses.asdict` after a round trip through JSON.

    A field that is missing in the document keeps its value in `base`, or takes its default.

    Args:
        base: the dataclass, or an instance that provides values missing in the document. Fields are booleans, numbers,
            texts, literals, tuples, dataclasses, or one of these or None.
        written: the document or a part of it.

    Raises:
        InputError: a field does not exist, or a value has the wrong type or is out of bounds.
    """
    kind = cast(Any, base if isinstance(base, type) else type(base))
    hints = typing.get_type_hints(kind, include_extras=True)
    members = written.members()
    for name, member in members.items():
        if name not in hints:
            near = difflib.get_close_matches(name, hints, 1, 0)[0]
            raise member.refuse(f"a setting that {kind.__name__} has, such as {near}")
    values = {name: _value(hints[name], member, base=getattr(base, name, None)) for name, member in members.items()}
    try:
        return kind(**values) if isinstance(base, type) else replace(cast(Any, base), **values)
    except (TypeError, ValueError) as error:
        raise written.refuse(f"settings that {kind.__name__} takes ({error})") from error


def check_config(config: object, source: str) -> None:
    """Refuse a config, made in Python, with a value of the wrong type or out of bounds.

    Raises:
        InputError: a setting is wrong; the message names `source` and the first such setting.
    """
    written = JsonValue(_plain(dataclasses.asdict(cast(Any, config))), source, advice="give another value")
    config_from_json(type(config), written)


def check_field(hint: Any, value: object, source: str) -> None:
    """Refuse a value that does not have a field's type or is out of its bounds.

    Raises:
        InputError: the value is wrong; the message names `source`.
    """
    _value(hint, JsonValue(_plain(value), source, advice="give another value"))


def read_settings(path: Path) -> JsonValue:
    """Read a file of settings, TOML if its name ends in .toml and JSON otherwise.

    Raises:
        InputError: the file cannot be read, or is not of that format.
    """
    if path.suffix.lower() != ".toml":
        return read_json(path, "settings", most=LARGEST_FILE)
    try:
        return JsonValue(tomllib.loads(read_text(path, "settings", LARGEST_FILE)), str(path))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        found = f"something else ({reason(error)})"
        raise InputError(f"{path}: expected settings as TOML, found {found}; fix the file.") from error


def _plain(value: Any) -> Any:
    """Convert a value to its JSON representation."""
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _value(hint: Any, written: JsonValue, bounds: Between | None = None, base: Any = None) -> Any:
    """Read a value of the type that a field declares; `base` is the nested config to update, if any."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        declared = next((extra for extra in arguments[1:] if isinstance(extra, Between)), bounds)
        return _value(arguments[0], written, declared, base)
    if origin in (typing.Union, types.UnionType):
        if written.value is None and type(None) in arguments:
            return None
        (hint,) = (argument for argument in arguments if argument is not type(None))
        return _value(hint, written, bounds, base)
    if origin is typing.Literal:
        return written.choice(arguments)
    if origin is tuple:
        return _tuple(arguments, written, bounds)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return config_from_json(hint if base is None else base, written)
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
