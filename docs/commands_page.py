"""Fills the site's page of commands with the help texts of the program, so that they are always current.

MkDocs calls `on_page_markdown` for every page (`hooks` in mkdocs.yml).
"""

import contextlib
import io
import os
import re
from unittest import mock

from neural_strands.cli.main import COMMANDS, main

PLACE = "<!-- help texts -->"
COLUMNS = 82
"""Width of the lists of options, characters; that of the page."""
TITLE = re.compile(r"^ (\w.*)$", re.MULTILINE)
"""Title of a list of options, as tyro prints it where it draws no boxes."""
RULE = re.compile(r"^ +-{10,}\n", re.MULTILINE)
NO_DEFAULT = re.compile(r"\s+\(default:(?:\s+None|\s*)\)")
"""Said of options that are off unless they are given."""


def on_page_markdown(markdown: str, **_: object) -> str:
    """Replace the mark on the page by one section per command."""
    return markdown.replace(PLACE, sections()) if PLACE in markdown else markdown


def sections() -> str:
    """Markdown with the help text of every command and every edit."""
    parts = []
    for name in COMMANDS:
        text = help_text([name])
        parts.append(f"## {name}\n\n{_in_markdown(text)}")
        if name == "edit":
            edits = re.findall(r"[a-z]+", re.findall(r"\[\{([a-z,]+)\}\]", text)[0])
            parts += [f"### edit … {edit}\n\n{_in_markdown(help_text(['edit', 'RUN', 'OUT', edit]))}" for edit in edits]
    return "\n\n".join(parts)


def help_text(words: list[str]) -> str:
    """What `--help` prints."""
    printed = io.StringIO()
    environment = {"COLUMNS": str(COLUMNS), "TERM": "dumb", "NO_COLOR": "1"}
    with mock.patch.dict(os.environ, environment), contextlib.redirect_stdout(printed):
        status = main([*words, "--help"])
    if status != 0:
        raise RuntimeError(f"{' '.join(words)} --help ended with status {status}")
    return "\n".join(line.rstrip() for line in printed.getvalue().splitlines()).strip()


def _in_markdown(text: str) -> str:
    """The usage and the options in blocks, and what lies between them as text."""
    first = TITLE.search(text)
    prose, options = (text, "") if first is None else (text[: first.start()], text[first.start() :])
    usage, _, prose = prose.partition("\n\n")
    blocks = [f"```text\n{usage.removeprefix('usage: ')}\n```", prose.strip()]
    if options:
        options = NO_DEFAULT.sub("", RULE.sub("", TITLE.sub(r"\1:", options)))
        blocks.append(f"```text\n{options}\n```")
    return "\n\n".join(blocks)
