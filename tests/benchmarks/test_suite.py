"""The synthetic suite: fits are scored from the files that `neural-strands fit` writes."""

import json

import pytest
from tiny_capture import true_segments, write_capture

from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.lmvs.files import save_segments
from neural_strands.runs.run_folder import RunFolder


@pytest.fixture(scope="module")
def suite(benchmark_module):
    return benchmark_module("quality", "suite")


def write_run(folder, strands):
    """The strands and segments of a fit, where a fit leaves them."""
    run = RunFolder(folder)
    write_groom(run.groom_arrays, Groom.from_strands(Strands(strands)))
    save_segments(run.segments, true_segments(strands))


@pytest.fixture
def rendered(tmp_path):
    """A suite of which one case is rendered; returns its folder and the true strands."""
    return tmp_path, write_capture(tmp_path / "captures" / "wavy_long", views=2)


def test_fits_are_read_from_their_runs(suite, rendered, capsys):
    """The true strands as fitted ones are perfect, which traced strands never are."""
    root, true = rendered
    write_run(root / "runs" / "wavy_long", true)
    suite.main(suite.Arguments("score", root, label="fits", runs=root / "runs"))
    assert "bob_waves: not rendered yet, left out" in capsys.readouterr().out
    (row,) = json.loads((root / "fits.json").read_text())["rows"]
    assert (row["case"], row["half"], row["seed"], row["strands"]) == ("wavy_long", "tuning", 0, len(true))
    assert min(row["f_scores"]) > 99
    assert row["consistency"] > 99
    assert row["length_ratios"] == pytest.approx([1.0, 1.0], rel=1e-3)
    assert min(row["segment_scores"][1]) > 99


def test_cases_without_a_fit_are_left_out_and_named(suite, rendered, capsys):
    root, _ = rendered
    suite.main(suite.Arguments("score", root, runs=root / "runs"))
    assert "wavy_long: not fitted yet, left out" in capsys.readouterr().out


def test_a_fit_is_not_scored_as_several_seeds(suite, rendered):
    with pytest.raises(SystemExit, match="--seeds: expected 1 with --runs"):
        suite.main(suite.Arguments("score", rendered[0], runs=rendered[0], seeds=3))


@pytest.fixture
def faked(suite, monkeypatch):
    """Replace rendering and scoring by functions that only note their calls; a set holds cases that fail."""
    called, broken = [], set()

    def build(case, data, folder):
        called.append(("build", case.name))
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "transforms.json").touch()
        return case.views

    def score(case, arguments, seed):
        if case.name in broken:
            raise RuntimeError("stopped")
        called.append(("score", case.name, seed))
        shares = [[float(len(called)), 1.0]] * 3
        return suite.Row(case.name, case.half, seed, 100, [1.0, 2.0, 3.0], shares, 4.0, [0.5, 1.0], 0.0)

    monkeypatch.setattr(suite, "build", build)
    monkeypatch.setattr(suite, "score", score)
    return called, broken


def scored(root, label="first_strands"):
    """Case and seed of every row in the results."""
    return [(row["case"], row["seed"]) for row in json.loads((root / f"{label}.json").read_text())["rows"]]


def test_one_command_renders_and_scores_and_goes_on_where_it_was_stopped(suite, faked, tmp_path, capsys):
    called, broken = faked
    broken.add("long_curls")
    with pytest.raises(RuntimeError, match="stopped"):
        suite.main(suite.Arguments("run", tmp_path, seeds=2))
    first = [("wavy_long", 0), ("wavy_long", 1), ("bob_waves", 0), ("bob_waves", 1)]
    assert scored(tmp_path) == first
    broken.clear()
    before = list(called)
    suite.main(suite.Arguments("run", tmp_path, seeds=2))
    rest = called[len(before) :]
    # Neither rendered nor scored again.
    assert not [call for call in rest if call[1] in ("wavy_long", "bob_waves")]
    assert [call[1:] for call in called if call[0] == "score"] == [
        (case.name, seed) for case in suite.CASES for seed in (0, 1)
    ]
    assert scored(tmp_path) == [(case.name, seed) for case in suite.CASES for seed in (0, 1)]
    count = len(called)
    suite.main(suite.Arguments("run", tmp_path, seeds=2))
    assert len(called) == count
    assert capsys.readouterr().out.endswith((tmp_path / "first_strands.txt").read_text())


def test_more_seeds_add_rows_to_those_that_are_there(suite, faked, tmp_path):
    called, _ = faked
    suite.main(suite.Arguments("run", tmp_path, only=("wavy_long",)))
    suite.main(suite.Arguments("run", tmp_path, only=("wavy_long",), seeds=3))
    assert [call[2] for call in called if call[0] == "score"] == [0, 1, 2]
    suite.main(suite.Arguments("score", tmp_path, only=("wavy_long",)))
    assert scored(tmp_path) == [("wavy_long", 0), ("wavy_long", 1), ("wavy_long", 2)]


def test_rows_of_other_cases_survive_the_choice_of_one_and_only_it_is_scored_again(suite, faked, tmp_path):
    called, _ = faked
    suite.main(suite.Arguments("run", tmp_path, only=("short_style", "wavy_long")))
    suite.main(suite.Arguments("run", tmp_path, only=("bob_waves",)))
    assert scored(tmp_path) == [("wavy_long", 0), ("bob_waves", 0), ("short_style", 0)]
    before = json.loads((tmp_path / "first_strands.json").read_text())["rows"]
    count = len(called)
    suite.main(suite.Arguments("score", tmp_path, only=("bob_waves",), again=True))
    assert called[count:] == [("score", "bob_waves", 0)]
    after = json.loads((tmp_path / "first_strands.json").read_text())["rows"]
    assert (after[0], after[2]) == (before[0], before[2])
    assert after[1]["segment_scores"] != before[1]["segment_scores"]


def test_rendering_alone_scores_nothing_and_scoring_alone_renders_nothing(suite, faked, tmp_path, capsys):
    called, _ = faked
    suite.main(suite.Arguments("build", tmp_path, only=("wavy_long",)))
    assert called == [("build", "wavy_long")]
    assert not (tmp_path / "first_strands").exists()
    suite.main(suite.Arguments("score", tmp_path, only=("wavy_long", "bob_waves")))
    assert called[1:] == [("score", "wavy_long", 0)]
    assert "bob_waves: not rendered yet, left out" in capsys.readouterr().out


def test_rows_of_other_strands_are_not_mixed(suite, faked, tmp_path):
    suite.main(suite.Arguments("run", tmp_path, only=("wavy_long",)))
    with pytest.raises(SystemExit, match="choose another --label"):
        suite.main(suite.Arguments("run", tmp_path, only=("bob_waves",), strands=500))
    with pytest.raises(SystemExit, match="choose another --label"):
        suite.main(suite.Arguments("score", tmp_path, runs=tmp_path / "runs"))
    assert scored(tmp_path) == [("wavy_long", 0)]
    with pytest.raises(SystemExit, match="found wavy"):
        suite.main(suite.Arguments("run", tmp_path, only=("wavy",)))
