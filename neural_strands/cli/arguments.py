"""From words to a command: tyro parses them, and whatever it complains about becomes one sentence."""

import contextlib
import dataclasses
import difflib
import io
import re
import shlex
import typing
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import tyro

from neural_strands.foundation.configs import check_field
from neural_strands.foundation.errors import InputError

C = TypeVar("C")

SUBCOMMANDS = re.compile(r"\[?\{([a-z,-]+)\}\]?$", re.MULTILINE)
"""The names of subcommands, at the end of the usage line."""
OPTION = re.compile(r"(?<![\w-])--[a-z][\w.-]*\w")
"""An option's name as help texts write it."""
MOST_NAMES = 6
"""Words that are tried as the names of a subcommand and of what stands before it."""
RULE = re.compile(r"^.*[\u2500-\u257f].*$|^-{4,}$")
"""A line that tyro draws to part a complaint from its title and from advice, in a box or, in ASCII, without one."""
REWORDED = (
    (r"Missing from \S+ \S+(?: \S+)?: (\S+) .*", r"\1: expected a value, found none"),
    (r"Missing value for argument '(\S+)'\. Expected 1 values.*", r"\1: expected a value, found none"),
    (r"Missing value for argument '(\S+)'\. Expected (.+?) values.*", r"\1: expected \2 values, found fewer"),
    (r"invalid choice (.+) for argument '(\S+)'\. Expected one of \((.+)\).*", r"\2: expected one of \3, found \1"),
    (
        r"Error parsing (\S+): no type matching (.+?) could be instantiated from \[(.*?)\].*",
        r"\1: expected \2, found \3",
    ),
    (r"Error parsing (\S+): invalid literal for int\(\) with base 10: (.+)", r"\1: expected a whole number, found \2"),
    (r"Error parsing (\S+): could not convert string to float: (.+)", r"\1: expected a number, found \2"),
    (r"Unrecognized options: (.*)", r"\1: expected no further words, found these"),
    (r"expected \{(.+?)\}", r"expected \1"),
    (r"expected INT,", "expected a whole number,"),
    (r"expected FLOAT,", "expected a number,"),
)
"""Patterns of what tyro says, and how it is said here; another wording of tyro's passes as it is."""


def parse(command: type[C], prog: str, words: Sequence[str]) -> C | None:
    """Parse the words of one command; None where `--help` was among them, which is printed then.

    Args:
        command: dataclass of the arguments.
        prog: how the command is called, for help and complaints.
        words: what follows on the command line.

    Raises:
        InputError: one sentence about the first word that does not fit.
    """
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            parsed = _parse(command, prog, words)
            check_numbers(parsed)
            return parsed
    except SystemExit as stop:
        if not stop.code:
            return None
    known, said = _help(command, prog, words), _said(complaint.getvalue())
    sentence = _unknown_option(known, words) or _unknown_subcommand(known, said) or _reworded(said)
    asked = " ".join([prog, *map(shlex.quote, known.subcommand)])
    raise InputError(f"{sentence}; `{asked} --help` lists its options.")


def check_numbers(command: object) -> None:
    """Refuse numbers of a command outside the bounds that its fields declare; all numbers must be finite.

    Raises:
        InputError: one sentence that names the option.
    """
    hints = typing.get_type_hints(type(command), include_extras=True)
    for each in dataclasses.fields(cast(Any, command)):
        value = getattr(command, each.name)
        first = value[0] if isinstance(value, tuple) and value else value
        if isinstance(first, int | float) and not isinstance(first, bool):
            check_field(hints[each.name], value, f"--{each.name.replace('_', '-')}")


def _parse(command: type[C], prog: str, words: Sequence[str]) -> C:
    markers = (tyro.conf.DisallowNone, tyro.conf.FlagCreatePairsOff, tyro.conf.PositionalMetavarFromFieldName)
    return tyro.cli(command, prog=prog, args=list(words), config=markers)


@dataclass(frozen=True)
class _Help:
    """What the help texts of a command, and of the subcommand among its words, tell.

    Attributes:
        options: names of all options.
        subcommands: names of the command's subcommands.
        subcommand: the words up to that subcommand; empty if there is none.
    """

    options: Sequence[str]
    subcommands: Sequence[str]
    subcommand: Sequence[str]


def _help(command: type, prog: str, words: Sequence[str]) -> _Help:
    """Read the help texts of a command and of the subcommand among its first words."""
    plain = [word for word in words if not word.startswith("-")]
    texts = []
    for end in range(min(len(plain), MOST_NAMES) + 1):
        text = io.StringIO()
        with (
            contextlib.redirect_stdout(text),
            contextlib.redirect_stderr(io.StringIO()),
            contextlib.suppress(SystemExit),
        ):
            _parse(command, prog, [*plain[:end], "--help"])
        texts.append(text.getvalue())
    choices = SUBCOMMANDS.search(texts[0])
    subcommands = choices[1].split(",") if choices else []
    last = next((end for end in range(1, len(texts)) if plain[end - 1] in subcommands and texts[end] != texts[0]), 0)
    return _Help(sorted({name for text in texts for name in OPTION.findall(text)}), subcommands, plain[:last])


def _unknown_option(known: _Help, words: Sequence[str]) -> str | None:
    """What to say about the first option that the command does not have, if there is one."""
    for word in words:
        name = word.partition("=")[0].replace("_", "-")
        if name.startswith("--") and len(name) > 2 and name not in known.options:
            near = difflib.get_close_matches(name, known.options, 1, 0)
            return f"{name}: expected an option such as {near[0]}, found none of that name"
    return None


def _unknown_subcommand(known: _Help, said: str) -> str | None:
    """What to say about a word where a subcommand could stand, if tyro complains of it."""
    left = re.fullmatch(r"Unrecognized options: (\S+).*", said)
    if left is None or known.subcommand or not known.subcommands:
        return None
    return f"{left[1]}: expected one of {', '.join(known.subcommands)}, found none of that name"


def _reworded(said: str) -> str:
    """What tyro said, in the words of this program."""
    for pattern, words in REWORDED:
        said = re.sub(pattern, words, said)
    return said


def _said(complaint: str) -> str:
    """What stands between the first two rules that tyro drew."""
    parts: list[list[str]] = [[]]
    for line in complaint.splitlines():
        inner = line.strip(" │")
        if RULE.match(inner):
            parts.append([])
        else:
            parts[-1].append(inner)
    return " ".join(" ".join(parts[1] if len(parts) > 1 else parts[0]).split()).rstrip(".")
