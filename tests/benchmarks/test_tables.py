"""The command for all tables: finished cells stay, missing ones are named, and figures are in their columns."""

import json

import pytest
from tiny_capture import write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head

LEVELS = ("1mm/10deg", "2mm/20deg", "3mm/30deg", "4mm/40deg")


@pytest.fixture(scope="module")
def tables(benchmark_module):
    return benchmark_module("quality", "tables")


@pytest.fixture(scope="module")
def cells(benchmark_module):
    return benchmark_module("quality", "table_cells")


@pytest.fixture(scope="module")
def rows(benchmark_module):
    return benchmark_module("quality", "table_rows")


def geometry(base):
    shares = {"precision": base + 10.0, "recall": base - 10.0, "f_score": base, "strand_consistency": base / 2}
    return dict.fromkeys(LEVELS, shares)


def picture(psnr):
    alpha = {"mean_absolute_error": 0.04, "outline_iou": 0.94}
    return {"psnr": psnr, "ssim": 0.5, "lpips": None, "flip": 0.1, "sharpness": 0.8, "alpha": alpha}


def answers(name, words):
    """Output of a cell's commands, as in their own tests."""
    seed = float(name.rsplit("_", 1)[1]) if name.startswith(("fit", "evaluate")) else 0.0
    if name.startswith(("fit", "fewer")) and "fit" in words:
        return {"strands": 6000, "steps": 400}
    if name.startswith("evaluate"):
        return {
            "strands": geometry(40 + seed),
            "lmvs": geometry(20),
            "held_out_views": {**picture(25 + seed), "without_grain": {"hair": picture(26 + seed)}},
            "milliseconds": {"decode": 60, "render": 160},
            "inside_head_percent": 0.5,
        }
    if name.startswith("rulers"):
        halves = dict.fromkeys(LEVELS, 53.3)
        return {"strands": 400, "half_against_half": halves, "blurred": {"4 px": {**picture(27.95), "lpips": 0.768}}}
    if name.startswith("score"):
        return {"mean": {"hair": picture(22.5 if name.endswith("clean") else 22)}}
    if name.startswith("truth"):
        return geometry(35)
    if "splats" in name:
        scores = {"mean": {"hair": picture(23.85)}}
        return {"splats": 68560, "iterations": 2600, "processor_minutes": 25.2, "scores": scores}
    return {}


@pytest.fixture
def faked(cells, monkeypatch):
    """Replace commands by ones that only answer; yields their names in the order of the calls."""
    called = []

    def run(self, name, words):
        called.append(name)
        if self.out.joinpath("broken").exists() and name.startswith("rulers"):
            raise cells.MissingError("failed: see rulers.log")
        if name.startswith("ablations"):
            found = {
                "strands": geometry(30 + float(name[-1])),
                "held_out_views": picture(24),
                "described": {"strands": 6000},
                "inside_head_percent": 0.5,
                "seconds": 60.0 * (1 + float(name[-1])),
            }
            folder = self.out / "ablations" / name.removeprefix("ablations_")
            folder.mkdir(parents=True)
            (folder / "table.json").write_text(json.dumps({"full": [found], "strided UNet": [found]}))
        return answers(name, words)

    monkeypatch.setattr(cells.Cells, "_run", run)
    return called


@pytest.fixture
def asked(tmp_path, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    write_capture(tmp_path / "data" / "ball", views=10)
    return {"out": tmp_path / "out", "data": tmp_path / "data", "preset": "demo", "seeds": 2, "views": (4, 24)}


def test_every_table_is_written_and_made_once(tables, faked, asked, capsys):
    tables.main(tables.Arguments(**asked, opensplat=asked["out"] / "program"))
    text = capsys.readouterr().out
    assert (asked["out"] / "tables.md").read_text() == text
    assert "weights" in text.splitlines()[0]
    lines = text.splitlines()
    for line in (
        "| ball: LMVS | - | 30.0 10.0 20.0 ± 0.0 | 30.0 10.0 20.0 ± 0.0 | 30.0 10.0 20.0 ± 0.0 |  |  |",
        "| ball: half of the truth against the other | 200 | - - 53.3 | - - 53.3 | - - 53.3 |  |  |",
        "| paper, short: LMVS | - | 56.9 12.1 20.0 | 93.4 30.3 45.8 | 98.9 46.6 63.4 |  |  |",
        "| ball | ours | 25.50 ± 0.50 | 0.500 ± 0.000 | - | 0.100 ± 0.000 | 0.80 ± 0.00 | 0.040 ± 0.000 "
        "| 0.940 ± 0.000 | 6,000 strands | 0.0 ± 0.0 |",
        "| ball | ours, without grain | 26.50 ± 0.50 | 0.500 ± 0.000 | - | 0.100 ± 0.000 | 0.80 ± 0.00 |  |  |  |  |",
        "| ball | 3D Gaussian splats (OpenSplat) | 23.85 | 0.500 | - | 0.100 | 0.80 | - | - "
        "| 68,560 splats, 2,600 iterations | 25.2 |",
        "| ball | photograph, blurred by 4 px | 27.95 | 0.500 | 0.768 | 0.100 | 0.80 |  |  |  |  |",
        "| ball | 60 ± 0 | 160 ± 0 | 220 ± 0 | 6,000 ± 0 |",
        "| full | 6,000 | 40.5 20.5 30.5 ± 0.5 | 40.5 20.5 30.5 ± 0.5 | 40.5 20.5 30.5 ± 0.5 | 15.2 ± 0.2 "
        "| 0.50 ± 0.00 | 24.00 ± 0.00 | 0.500 ± 0.000 | - | 1.5 ± 0.5 |",
        "| ball, 4 | ours | 6,000 | 35.0 / 35.0 / 35.0 | 22.00 | 0.500 | - | 0.100 | 0.80 |",
        "| ball, 4 | ours, without grain |  |  | 22.50 | 0.500 | - | 0.100 | 0.80 |",
        "| ball, 4 | splats | 68,560 | - | 23.85 | 0.500 | - | 0.100 | 0.80 |",
    ):
        assert line in lines
    assert not any(line.startswith("| ball, 24") for line in lines)
    before = list(faked)
    assert len(set(before)) == len(before)
    tables.main(tables.Arguments(**asked, opensplat=asked["out"] / "program"))
    assert faked == before
    assert capsys.readouterr().out == text


def test_a_prior_of_positions_is_trained_once_or_taken(cells, tmp_path, monkeypatch):
    commands = []

    def run(self, name, words):
        commands.append((name, words))
        if name.startswith("ablations"):
            folder = self.out / "ablations" / name.removeprefix("ablations_")
            folder.mkdir(parents=True)
            (folder / "table.json").write_text(json.dumps({"full": [{"psnr": 25.0}]}))
        return {}

    def after(option, words):
        return words[words.index(option) + 1]

    monkeypatch.setattr(cells.Cells, "_run", run)
    own = cells.Cells(tmp_path / "out", cells.Settings("demo", None), None)
    assert own.ablations(tmp_path / "ball", 0) == {"full": {"psnr": 25.0}}
    own.ablations(tmp_path / "ball", 1)
    assert [name for name, _ in commands] == ["positions_prior", "ablations_ball_0", "ablations_ball_1"]
    trained = commands[0][1]
    assert after("--config.generator.synthesiser.output", trained) == "position"
    assert "--resume" not in trained
    for _, words in commands[1:]:
        assert after("--positions-prior", words) == after("train-prior", trained)
    given = cells.Cells(tmp_path / "other", cells.Settings("demo", None), None, tmp_path / "prior.safetensors")
    given.ablations(tmp_path / "ball", 0)
    assert len(commands) == 4
    assert after("--positions-prior", commands[-1][1]) == str(tmp_path / "prior.safetensors")


def test_a_prior_that_could_not_be_trained_is_named_and_its_training_goes_on(cells, tmp_path, monkeypatch):
    commands = []

    def run(self, name, words):
        commands.append(words)
        (self.out / "positions_prior.checkpoint.pt").touch()
        raise cells.MissingError("failed: see positions_prior.log")

    monkeypatch.setattr(cells.Cells, "_run", run)
    own = cells.Cells(tmp_path, cells.Settings("demo", None), None)
    for _ in range(2):
        assert own.ablations(tmp_path / "ball", 0) == {"missing": "failed: see positions_prior.log"}
    assert ["--resume" in words for words in commands] == [False, True]


def test_what_is_missing_is_named_and_tried_again(tables, faked, asked, capsys):
    asked["out"].mkdir()
    (asked["out"] / "broken").touch()
    tables.main(tables.Arguments(**asked, only=("pictures",)))
    lines = capsys.readouterr().out.splitlines()
    lack = "OpenSplat's program is not given (--opensplat)"
    assert f"| ball | 3D Gaussian splats (OpenSplat) | {lack} |  |  |  |  |  |  |  |  |" in lines
    assert any(line.startswith("| ball | photograph, blurred | failed: see rulers.log |") for line in lines)
    (asked["out"] / "broken").unlink()
    tables.main(tables.Arguments(**asked, only=("pictures",), opensplat=asked["out"] / "program"))
    text = capsys.readouterr().out
    assert "missing" not in text
    assert "blurred by 4 px" in text
    assert "68,560 splats" in text
    assert faked.count("fit_ball_0") == 1


def test_settings_are_not_mixed_and_captures_must_be_there(tables, faked, asked):
    tables.main(tables.Arguments(**asked, only=("times",)))
    with pytest.raises(SystemExit, match="other settings"):
        tables.main(tables.Arguments(**asked, only=("times",), steps=3))
    with pytest.raises(SystemExit, match="expected captures cube, found ball"):
        tables.main(tables.Arguments(**asked, captures=("cube",)))
    with pytest.raises(SystemExit, match="found none; name their folder"):
        tables.main(tables.Arguments(**{**asked, "data": asked["out"]}))


def test_a_command_answers_fails_and_counts_its_minutes(cells, tmp_path):
    made = cells.Cells(tmp_path, cells.Settings("demo", None), None)
    program = "import json, sys; print('words first'); print(json.dumps({'a': int(sys.argv[1])}, indent=1))"
    assert made._run("one", ["-c", program, "7"]) == {"a": 7}
    first = made.minutes("one")
    assert first > 0
    assert made._run("one", ["-c", "print('no figures')"]) == {}
    assert made.minutes("one") > first
    with pytest.raises(cells.MissingError, match=r"failed: see .*two\.log"):
        made._run("two", ["-c", "import sys; sys.exit('because of this')"])
    assert "because of this" in (tmp_path / "cells" / "two.log").read_text()


def test_the_views_that_are_shown_are_far_apart(cells, tmp_path):
    """Eight cameras on a circle: of two, the second is opposite; of four, every other one."""
    write_capture(tmp_path / "ball", views=8)
    capture = Capture.load(tmp_path / "ball")
    assert cells.spread_views(capture, range(8), 2) == [0, 4]
    assert cells.spread_views(capture, range(8), 4) == [0, 2, 4, 6]
    assert cells.spread_views(capture, range(1, 8), 99) == list(range(1, 8))


def test_some_views_of_a_capture_are_a_capture(cells, tmp_path):
    write_capture(tmp_path / "ball", views=6)
    whole = Capture.load(tmp_path / "ball")
    cells.write_part(whole, [1, 4], tmp_path / "part")
    part = Capture.load(tmp_path / "part")
    assert [camera.name for camera in part.cameras] == ["001.png", "004.png"]
    assert (part.image(1) == whole.image(4)).all()
    assert (part.hair_mask(0) == whole.hair_mask(1)).all()
    assert len(find_head(part, None).scalp_faces) == len(find_head(whole, None).scalp_faces)


def test_figures_over_seeds(rows):
    assert rows.over_seeds([1.0, 2.0, 4.5], 1) == "2.5 ± 1.8"
    assert rows.over_seeds([1.25], 2) == "1.25"
    assert rows.over_seeds([1.0, None], 2) == "-"
    assert rows.over_seeds([], 2) == "-"
