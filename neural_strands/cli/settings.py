"""Commands with nested settings: from a preset, a file (`--config FILE`), or one by one (`--config.NAME VALUE`)."""

from collections.abc import Callable, Sequence
from dataclasses import field, make_dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from neural_strands.cli.arguments import parse

C = TypeVar("C")

LISTING = "--help-config"
"""The option that lists every setting."""


def parse_with_settings(
    command: type[C], prog: str, words: Sequence[str], base: Callable[[str, Path | None], Any]
) -> C | None:
    """Parse the words of a command whose field `settings` holds a nested config; None if they ask for help.

    Nested settings are parsed, and torch imported with them, only if the words name or list one; otherwise the field
    stays None.

    Args:
        command: dataclass of the arguments, with the fields `preset`, `config` (a file) and `settings`.
        prog: how the command is called.
        words: what follows on the command line.
        base: makes the config of a preset and an optional file, which single settings then change.

    Raises:
        InputError: one sentence about the first word that does not fit.
    """
    listing = LISTING in words
    if not listing and not any(word.startswith("--config.") for word in words):
        return parse(command, prog, words)
    file = _given(words, "--config")
    config = base(_given(words, "--preset") or getattr(command, "preset"), None if file is None else Path(file))  # noqa: B009
    nested = ("settings", Annotated[type(config), tyro.conf.arg(name="config")], field(default=config))
    whole = make_dataclass(command.__name__, [nested], bases=(command,), frozen=True)
    whole.__doc__ = command.__doc__
    return parse(whole, prog, ["--help"] if listing else words)


def _given(words: Sequence[str], option: str) -> str | None:
    """The value of an option, found before the words are parsed."""
    for word, following in zip(words, [*words[1:], None], strict=True):
        if word == option:
            return following
        if word.startswith(f"{option}="):
            return word.partition("=")[2]
    return None
