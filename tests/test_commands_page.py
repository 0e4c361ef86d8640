"""The page of commands on the site holds the help text of every command."""

import importlib.util
import re
from pathlib import Path

import pytest

from neural_strands.cli.main import COMMANDS

DOCS = Path(__file__).resolve().parents[1] / "docs"


@pytest.fixture(scope="module")
def page() -> str:
    specification = importlib.util.spec_from_file_location("commands_page", DOCS / "commands_page.py")
    assert specification is not None
    assert specification.loader is not None
    hook = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(hook)
    assert hook.on_page_markdown("another page") == "another page"
    return hook.on_page_markdown((DOCS / "commands.md").read_text(encoding="utf-8"))


def test_every_command_has_its_section(page: str):
    assert re.findall(r"^## (.+)$", page, re.MULTILINE) == list(COMMANDS)
    for name in COMMANDS:
        assert f"neural-strands {name}" in page.split(f"\n## {name}\n")[1].split("\n## ")[0]


def test_options_of_commands_and_edits_are_there(page: str):
    assert "--longest-side INT" in page.split("\n## prepare\n")[1].split("\n## ")[0]
    assert "--plane" in page.split("\n### edit … haircut\n")[1].split("\n### ")[0]
    assert page.count("### edit … ") == 7
    assert re.search("^ *-{4,}$", page, re.MULTILINE) is None
    assert page.count("```") % 2 == 0
