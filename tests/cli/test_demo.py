"""`demo`: the order of its stages, and what it says at the end; every stage has tests of its own."""

import json

import pytest

from neural_strands.cli.commands import demo
from neural_strands.cli.main import main

STAGES = ("Synthesize", "Check", "Fit", "Evaluate")


def test_the_last_line_names_the_command_that_shows_the_result(tmp_path, monkeypatch, capsys):
    ran = []

    def note(stage):
        ran.append(stage)

    for name in STAGES:
        monkeypatch.setattr(getattr(demo, name), "run", note)
    assert main(["demo", str(tmp_path / "out"), "--style", "short", "--seed", "3"]) == 0
    assert [type(stage).__name__ for stage in ran] == list(STAGES)
    run = tmp_path / "out" / "run"
    assert (ran[0].style, ran[0].seed, ran[2].seed, ran[2].out) == ("short", 3, 3, run)
    assert ran[0].shipped
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.endswith(f"in the browser: neural-strands view {run}")
    seconds = json.loads((tmp_path / "out" / "figures.json").read_text())["seconds"]
    assert list(seconds) == ["synthesize", "check", "fit", "evaluate"]


def test_photographs_can_be_rendered_instead_of_unpacked(tmp_path, monkeypatch):
    shipped = []

    def note(stage):
        if isinstance(stage, demo.Synthesize):
            shipped.append(stage.shipped)

    for name in STAGES:
        monkeypatch.setattr(getattr(demo, name), "run", note)
    assert main(["demo", str(tmp_path / "out"), "--render"]) == 0
    assert shipped == [False]


def test_a_stage_that_fails_ends_the_demo(tmp_path, monkeypatch):
    def fail(_: object) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr(demo.Synthesize, "run", fail)
    with pytest.raises(RuntimeError, match="broken"):
        main(["demo", str(tmp_path / "out")])
    assert not (tmp_path / "out" / "figures.json").exists()
