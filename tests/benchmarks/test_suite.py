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
