"""What the pages name exists: functions, files, commands, links; and the architecture's picture is current."""

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from neural_strands.cli.main import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.md")]
PACKAGES = "|".join(sorted(path.parent.name for path in (ROOT / "neural_strands").glob("*/__init__.py")))
NAME = re.compile(rf"`((?:{PACKAGES})(?:\.\w+)+)`")
FILE = re.compile(r"((?:neural_strands|benchmarks|tests|docs|examples)/[\w/]+\.(?:py|md|png|svg))")
LINK = re.compile(r"\]\(([^)#:]+)\)")
COMMAND = re.compile(r"neural-strands ([a-z][a-z-]+)")


def relative(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def resolves(name: str) -> bool:
    """Whether a dotted name below `neural_strands` is a module, or an attribute of one."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(["neural_strands", *parts[:end]]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_names_on_pages_exist(page: Path):
    text = page.read_text(encoding="utf-8")
    assert [name for name in NAME.findall(text) if not resolves(name)] == []
    assert [file for file in FILE.findall(text) if not (ROOT / file).exists()] == []
    assert [link for link in LINK.findall(text) if not (page.parent / link).exists()] == []
    assert set(COMMAND.findall(text)) <= set(COMMANDS)


@pytest.mark.parametrize("page", PAGES, ids=relative)
def test_examples_have_one_command_on_a_line(page: Path):
    # Lines merged into one, as when a block is wrapped like prose, no longer run.
    blocks = re.findall(r"^```\w*\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    assert [line for line in lines if len(COMMAND.findall(line)) > 1 or line.startswith("--")] == []
    for block in re.findall(r"^```toml\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
        tomllib.loads(block)


def test_the_names_are_found():
    assert resolves("capture.capture.Capture.load")
    assert not resolves("capture.capture.Capture.lode")
    assert not resolves("capture.captured")
    assert NAME.findall("`geometry.spline.fit_splines` and `geometry/spline.py`") == ["geometry.spline.fit_splines"]


def test_the_picture_of_the_architecture_is_current():
    script = ROOT / "docs" / "make_architecture.py"
    checked = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr
