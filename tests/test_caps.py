"""The size caps of the project, and words that have no place in it."""

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted(
    path for folder in ("neural_strands", "tests", "benchmarks", "examples") for path in (ROOT / folder).rglob("*.py")
)
TEXTS = sorted(
    {
        *FILES,
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "examples").glob("*.md"),
        ROOT / "Makefile",
        ROOT / "pyproject.toml",
    }
)
FILE_LINES, FUNCTION_LINES, PARAMETERS = 400, 100, 10
"""Everything stays under these."""
FILES_A_PACKAGE = 20
"""The most modules in one folder of the package, subfolders not counted."""
MACHINE_PATHS = re.compile(r"(?<![\w.])/(?:work|tmp|home|root|Users)/\w|[A-Z]:\\\\Users", re.IGNORECASE)
UNFINISHED = re.compile(r"\b(?:TO" + r"DO|FIX" + r"ME|X" + r"XX|HA" + r"CK)\b")
FUTURE = re.compile(r"^from __future__ import annotations", re.MULTILINE)


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def functions(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def is_kernel(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether this is a Warp kernel, which only the module beside it launches, with a list of one entry per array."""
    return any(ast.unparse(decorator).startswith("wp.kernel") for decorator in node.decorator_list)


def parameter_count(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Parameters that a caller gives: without self and cls, each of *args and **kwargs as one."""
    plain = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args)]
    if plain and plain[0] in ("self", "cls"):
        plain = plain[1:]
    return len(plain) + len(node.args.kwonlyargs) + bool(node.args.vararg) + bool(node.args.kwarg)


def crowded(folder: Path) -> list[str]:
    """The folders below one, itself included, that hold too many modules, each with their number."""
    counts = Counter(path.parent for path in folder.rglob("*.py"))
    found = sorted((parent, count) for parent, count in counts.items() if count > FILES_A_PACKAGE)
    return [f"{parent.relative_to(folder.parent).as_posix()} has {count} files" for parent, count in found]


def test_there_are_files():
    assert len(FILES) > 20


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_sizes(path: Path):
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines < FILE_LINES, f"{relative(path)} has {lines} lines"
    for node in functions(path):
        length = (node.end_lineno or node.lineno) - node.lineno + 1
        assert length < FUNCTION_LINES, f"{relative(path)}: {node.name} has {length} lines"
        public = not node.name.startswith("_") and not is_kernel(node)
        if public and relative(path).startswith("neural_strands/"):
            count = parameter_count(node)
            assert count < PARAMETERS, f"{relative(path)}: {node.name} takes {count} parameters"


@pytest.mark.parametrize("path", TEXTS, ids=relative)
def test_words(path: Path):
    text = path.read_text(encoding="utf-8")
    for pattern, reason in ((MACHINE_PATHS, "a path of one machine"), (UNFINISHED, "unfinished work")):
        found = pattern.search(text)
        assert found is None, f"{relative(path)}: {reason}: {found and found[0]!r}"
    assert FUTURE.search(text) is None, f"{relative(path)} imports annotations from the future"


def test_packages_are_small():
    assert crowded(ROOT / "neural_strands") == []


def test_a_crowded_package_is_found(tmp_path: Path):
    inner = tmp_path / "outer" / "inner"
    inner.mkdir(parents=True)
    for number in range(FILES_A_PACKAGE):
        (inner / f"module_{number}.py").touch()
        (inner.parent / f"module_{number}.py").touch()
    assert crowded(tmp_path / "outer") == []
    (inner / "one_more.py").touch()
    assert crowded(tmp_path / "outer") == [f"outer/inner has {FILES_A_PACKAGE + 1} files"]


def test_test_files_have_names_of_their_own():
    """Tests have no packages, so pytest tells modules apart by their file names."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


def test_the_counts_are_exact():
    node = ast.parse("def f(self, a, /, b, *c, d, **e):\n    pass\n").body[0]
    assert isinstance(node, ast.FunctionDef)
    assert parameter_count(node) == 5
    assert MACHINE_PATHS.search("see " + "/" + "home/me/x")
    assert not MACHINE_PATHS.search("/".join(["out", "work", "x"]) + " and https://a.b/home/x")
