"""`import neural_strands as ns`: what it offers, that it loads nothing, and that every example in it runs."""

import ast
import doctest
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import neural_strands as ns
from neural_strands.cli.main import main

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "api.md"
NAMES = [name for name in ns.__all__ if name != "__version__"]


def run_examples(test, capsys):
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(test)
    assert runner.summarize().failed == 0, capsys.readouterr().out


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_an_example_that_runs(name, workspace, capsys):
    text = getattr(ns, name).__doc__
    test = doctest.DocTestParser().get_doctest(text, {}, name, None, 0)
    assert test.examples
    run_examples(test, capsys)


@pytest.mark.slow(seconds=20)
def test_the_examples_of_the_page_run(workspace, capsys):
    text = "\n".join(re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL))
    test = doctest.DocTestParser().get_doctest(text, {}, PAGE.name, str(PAGE), 0)
    assert len(test.examples) > 5
    run_examples(test, capsys)


def test_the_page_lists_every_name_and_no_other():
    listed = re.findall(r"^\| `ns\.(\w+)", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted(NAMES)


def test_the_stub_says_where_each_name_is():
    tree = ast.parse((ROOT / "neural_strands" / "__init__.pyi").read_text(encoding="utf-8"))
    places = {}
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            places |= {alias.name: node.module for alias in node.names if alias.asname == alias.name}
    assert sorted(places) == sorted(NAMES)
    for name, module in places.items():
        assert getattr(importlib.import_module(module), name) is getattr(ns, name)


def test_names_are_offered_and_others_are_not():
    assert set(ns.__all__) == set(dir(ns))
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        getattr(ns, "fitt")  # noqa: B009


def test_import_loads_nothing_else():
    script = "import sys, neural_strands; print([m for m in sys.modules if m.startswith(('neural', 'torch', 'numpy'))])"
    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=True)
    assert ast.literal_eval(shown.stdout) == ["neural_strands"]


def test_the_version_is_written_once(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"neural-strands {ns.__version__}\n"
    settings = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'version = { attr = "neural_strands.__version__" }' in settings
    for path in (ROOT / "pyproject.toml", ROOT / "CITATION.cff"):
        assert ns.__version__ not in path.read_text(encoding="utf-8")


def test_a_subset_of_strands_in_memory_and_a_file_score_alike(workspace):
    segments = ns.make_segments(ns.load_capture("capture"), "found.npz")
    assert ns.score(segments, "capture") == ns.score("found.npz", "capture")
    groom = ns.read_groom("run/groom.npz")
    assert ns.score(groom, groom) == ns.score("run/groom.npz", groom.strands(None))


def test_segments_of_the_library_start_a_fit_and_those_of_held_out_views_do_not(workspace):
    capture = ns.load_capture("capture")
    ns.make_segments(capture, "all.npz", ns.FitConfig(hold_out_every=0))
    with pytest.raises(ns.InputError, match="that the fit holds out, found 2 of these 2"):
        ns.fit("capture", "refused", ns.FitConfig(steps=1), segments="all.npz")
    assert not Path("refused").exists()
    with pytest.raises(ns.InputError, match="config: steps: expected a whole number from 1"):
        ns.fit("capture", "refused", ns.FitConfig(steps=0))
