"""Reads JSON from untrusted files: size and depth are bounded, and every value is checked when it is used.

A `JsonValue` knows its place, so that each error names the file and the place: `transforms.json: frames[3].fl_x:
expected a finite number, found 'wide'; ...`.
"""

import gzip
import io
import json
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.foundation.input_files import has_controls, is_file_path, read_bytes

if TYPE_CHECKING:
    import numpy as np

LARGEST_JSON = 2**27
"""Largest document, bytes, after unpacking a .gz."""
LONGEST_TEXT = 1000
"""Longest accepted text, characters."""
LONGEST_KEY = 40
"""Longest name that a message repeats unchanged, characters."""


@dataclass(frozen=True)
class JsonValue:
    """A value in a JSON document, with its place.

    Attributes:
        value: the parsed value.
        source: the file, for error messages.
        place: keys and indices of the value, such as `frames[3].fl_x`; empty at the top level.
        advice: what the user should do about a wrong value.
    """

    value: Any
    source: str
    place: str = ""
    advice: str = "fix the file"

    def refuse(self, expected: str) -> InputError:
        """Build the error that says what was expected here."""
        where = f"{self.place}: " if self.place else ""
        return InputError(f"{self.source}: {where}expected {expected}, found {excerpt(self.value)}; {self.advice}.")

    def number(self, low: float = -math.inf, high: float = math.inf) -> float:
        """Take a finite number between two bounds, both included.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, int | float) and not isinstance(self.value, bool):
            try:
                number = float(self.value)
            except OverflowError:
                number = math.inf
            if math.isfinite(number) and low <= number <= high:
                return number
        raise self.refuse("a finite number" + _between(low, high))

    def whole(self, low: int, high: int) -> int:
        """Take a whole number between two bounds, both included; 512.0 is one too.

        Raises:
            InputError: the value is something else.
        """
        value = self.value
        integral = isinstance(value, int) or (isinstance(value, float) and value.is_integer())
        if integral and not isinstance(value, bool) and low <= value <= high:
            return int(value)
        raise self.refuse("a whole number" + _between(low, high))

    def flag(self) -> bool:
        """Take true or false.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, bool):
            return self.value
        raise self.refuse("true or false")

    def text(self, longest: int = LONGEST_TEXT) -> str:
        """Take a text without control characters.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, str) and len(self.value) <= longest and not has_controls(self.value):
            return self.value
        raise self.refuse(f"a text of at most {longest} letters without control characters")

    def file_path(self) -> str:
        """Take the path of a file, relative or not.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, str) and is_file_path(self.value):
            return self.value
        raise self.refuse("the path of a file")

    def choice(self, options: Sequence[str]) -> str:
        """Take one of the texts in `options`.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, str) and self.value in options:
            return self.value
        raise self.refuse(f"one of {', '.join(options)}")

    def elements(self) -> "list[JsonValue]":
        """Take the elements of a list.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, list):
            return [replace(self, value=value, place=f"{self.place}[{k}]") for k, value in enumerate(self.value)]
        raise self.refuse("a list")

    def members(self) -> "dict[str, JsonValue]":
        """Take the members of an object, by name.

        Raises:
            InputError: the value is something else.
        """
        if isinstance(self.value, dict):
            return {key: self._member(key) for key in self.value}
        raise self.refuse("an object in braces")

    def member(self, key: str) -> "JsonValue":
        """Take a member of an object.

        Raises:
            InputError: this is not an object, or it has no such member.
        """
        found = self.optional(key)
        if found is None:
            raise replace(self, value=list(self.value)).refuse(f"a value under '{key}'")
        return found

    def optional(self, key: str) -> "JsonValue | None":
        """Take a member of an object, or None if it is missing or null.

        Raises:
            InputError: this is not an object.
        """
        if not isinstance(self.value, dict):
            raise self.refuse("an object in braces")
        return None if self.value.get(key) is None else self._member(key)

    def array(self, *shape: int | None) -> "np.ndarray":
        """Take nested lists of finite numbers as a float64 array of this shape; None is any size.

        Raises:
            InputError: the value is something else.
        """
        import numpy as np

        try:
            found = np.array(self.value)
        except (ValueError, OverflowError, RecursionError):
            found = np.array(None)
        fits = found.ndim == len(shape) and all(
            side in (None, size) for side, size in zip(shape, found.shape, strict=True)
        )
        if fits and found.dtype.kind in "iuf" and np.isfinite(found).all():
            return found.astype(np.float64)
        sides = " x ".join("any" if side is None else str(side) for side in shape)
        raise self.refuse(f"finite numbers in lists of size {sides}")

    def wholes(self, low: int, high: int) -> list[int]:
        """Take a list of whole numbers between two bounds, both included.

        Raises:
            InputError: the value is something else; the message names the first wrong element.
        """
        if isinstance(self.value, list):
            if all(type(value) is int and low <= value <= high for value in self.value):
                return self.value
            return [element.whole(low, high) for element in self.elements()]
        raise self.refuse("a list of whole numbers")

    def _member(self, key: str) -> "JsonValue":
        plain = key.isidentifier() and len(key) <= LONGEST_KEY
        name = f"{'.' if self.place else ''}{key}" if plain else f"[{excerpt(key)}]"
        return replace(self, value=self.value[key], place=self.place + name)


def read_json(path: Path, what: str, advice: str = "fix the file", most: int = LARGEST_JSON) -> JsonValue:
    """Read a JSON document, which is unpacked first if the file's name ends in .gz.

    Args:
        path: the file.
        what: expected content, for error messages, such as "a list of face numbers".
        advice: what to do where it holds something else.
        most: largest document, bytes, unpacked.

    Raises:
        InputError: the file cannot be read, or is not JSON.
    """
    data = read_bytes(path, what, most)
    if path.suffix == ".gz":
        data = _unpacked(path, data, what, most)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected {what} as JSON in UTF-8, found other bytes; {advice}.") from error
    return parse_json(text, str(path), what, advice)


def parse_json(
    text: str, source: str, what: str, advice: str = "fix the file", with_constants: bool = False
) -> JsonValue:
    """Parse a JSON document in memory.

    Args:
        text: the document.
        source: origin of the document, for error messages.
        what: expected content, for error messages.
        advice: what to do where it holds something else.
        with_constants: whether NaN, Infinity and -Infinity, which JSON does not have, are accepted.

    Raises:
        InputError: it is not JSON, is nested too deeply, or repeats a member.
    """
    hooks: dict[str, Any] = {} if with_constants else {"parse_constant": _no_constant}
    try:
        return JsonValue(json.loads(text, object_pairs_hook=_members_once, **hooks), source, advice=advice)
    except (ValueError, RecursionError, MemoryError) as error:
        found = (
            "brackets nested too deeply" if isinstance(error, RecursionError) else f"something else ({reason(error)})"
        )
        raise InputError(f"{source}: expected {what} as JSON, found {found}; {advice}.") from error


def check_format(document: JsonValue, version: int) -> None:
    """Refuse a document whose member `format` is not the supported version of its layout.

    Raises:
        InputError: the member is missing, or has another version.
    """
    written = document.member("format")
    if type(written.value) is not int or written.value != version:
        raise replace(written, advice="use the version of neural-strands that wrote it").refuse(f"{version}")


def _unpacked(path: Path, data: bytes, what: str, most: int) -> bytes:
    """Unpack a gzip file; refused as soon as the content exceeds `most` bytes."""
    pieces: list[bytes] = []
    size = 0
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            while piece := file.read(2**20):
                pieces.append(piece)
                size += len(piece)
                if size > most:
                    raise InputError(
                        f"{path}: expected {what} of at most {most} bytes unpacked, found more; name another file."
                    )
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(
            f"{path}: expected {what} in an intact gzip file, found a damaged one ({reason(error)}); copy it again."
        ) from error
    return b"".join(pieces)


def _members_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Build an object; repeated members are refused because they are ambiguous."""
    members: dict[str, Any] = {}
    for name, value in pairs:
        if name in members:
            raise ValueError(f"the name {excerpt(name)} twice in one object")
        members[name] = value
    return members


def _no_constant(name: str) -> float:
    raise ValueError(f"{name}, which is no number of JSON")


def _between(low: float | int, high: float | int) -> str:
    """The bounds in words; empty if there are none."""
    if low == -math.inf and high == math.inf:
        return ""
    if high == math.inf:
        return f" of at least {low}"
    return f" of at most {high}" if low == -math.inf else f" from {low} to {high}"
