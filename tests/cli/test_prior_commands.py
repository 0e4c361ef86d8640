"""train-prior, prior-report and prior-traverse from the command line."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from neural_strands.cli.main import main
from neural_strands.geometry.frames import to_world
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom, write_groom
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.vae import load_prior
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import sample_roots


@pytest.fixture(scope="module")
def groom(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixty synthetic strands on the mannequin."""
    roots = sample_roots(mannequin(), 60, torch.Generator().manual_seed(0))
    local = synthetic_curves(60, torch.Generator().manual_seed(1))
    path = tmp_path_factory.mktemp("groom") / "groom.npz"
    write_groom(path, Groom.from_strands(Strands(to_world(local, roots.position, roots.frame))))
    return path


def test_train_prior_writes_weights_that_load(
    tmp_path: Path, groom: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("neural_strands.prior_training.curve_stream.CHUNK", 64)
    out = tmp_path / "prior.safetensors"
    words = ["train-prior", str(out), "--json", "--groom", str(groom), "--device", "cpu", "--config.steps", "2"]
    words += ["--config.sine-steps", "1", "--config.start-curves", "200", "--config.batch", "16"]
    assert main(words) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["held_out_mm"] < 0.5
    assert load_prior(out).generator.config.latent == 64
    assert main([*words, "--resume"]) == 0


def test_prior_report_gives_prior_pca_and_optimised_errors(
    tmp_path: Path, groom: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "report.png"
    words = ["prior-report", str(groom), "--json", "--picture", str(picture), "--curves", "600", "--device", "cpu"]
    assert main([*words, "--optimise-steps", "5"]) == 0
    errors = json.loads(capsys.readouterr().out)["groom.npz"]
    assert set(errors) == {"prior", "pca", "optimised"}
    assert errors["prior"]["strands"] == 60
    assert errors["prior"]["mean_mm"] < 0.3
    assert errors["optimised"]["mean_mm"] < errors["prior"]["mean_mm"] * 1.1
    assert picture.stat().st_size > 5000


def test_prior_report_prints_a_table(groom: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prior-report", str(groom), "--curves", "300", "--device", "cpu"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "groom.npz"
    assert [line.split()[0] for line in lines[2:]] == ["prior", "pca"]


def test_prior_report_reads_true_strands_of_a_capture(
    tmp_path: Path, groom: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strands = read_groom(groom).strands(100).points
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        np.savez(tmp_path / name / "ground_truth.npz", strands=strands.numpy(), unit=np.float64(1.0))
    words = ["prior-report", str(tmp_path / "one"), str(tmp_path / "two" / "ground_truth.npz"), str(groom), "--json"]
    assert main([*words, "--curves", "300", "--device", "cpu"]) == 0
    errors = json.loads(capsys.readouterr().out)
    assert set(errors) == {"one", "ground_truth.npz", "groom.npz"}
    # Without a head beside them they are the same strands on the same fitted mannequin.
    assert errors["one"]["prior"] == errors["ground_truth.npz"]["prior"]
    assert errors["one"]["prior"]["mean_mm"] == pytest.approx(errors["groom.npz"]["prior"]["mean_mm"], rel=0.05)


def test_reports_on_files_of_one_name_are_told_apart(
    tmp_path: Path, groom: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "groom.npz"
    other.write_bytes(groom.read_bytes())
    assert main(["prior-report", str(groom), str(other), "--json", "--curves", "300", "--device", "cpu"]) == 0
    assert set(json.loads(capsys.readouterr().out)) == {str(groom), str(other)}


def edited_groom(groom: Path, folder: Path, what: str) -> Path:
    """The groom with one fault."""
    strands = read_groom(groom).strands(100).points.numpy().copy()
    if what == "one point":
        strands = strands[:, :1]
    elif what == "zero length":
        strands[5] = strands[5, :1]
    elif what == "stubs":
        strands[:5] = strands[:5, :1] + 1e-3 * (strands[:5] - strands[:5, :1])
    elif what == "NaN":
        strands[3, 7, 1] = np.nan
    elif what == "long":
        strands[4] = strands[4, :1] + np.linspace([0, 0, 0], [0, -25, 0], 100)
    # Written with numpy alone, because our own writer would refuse some of these.
    np.savez(folder / "bad.npz", points=strands)
    return folder / "bad.npz"


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("one point", "at least two points"),
        ("zero length", "expected strands with a length, found strand 5 whose 100 points are all the same"),
        ("NaN", "finite"),
        ("long", "1 of 60 are shorter than 3 mm or longer than 2 m"),
    ],
)
def test_strands_that_no_prior_can_hold_are_one_sentence(
    tmp_path: Path, groom: Path, what: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["prior-report", str(edited_groom(groom, tmp_path, what)), "--curves", "300", "--device", "cpu"]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert len(printed.err.splitlines()) == 1
    assert printed.out == ""


def test_a_few_stubs_are_left_out(tmp_path: Path, groom: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["prior-report", str(edited_groom(groom, tmp_path, "stubs")), "--curves", "300", "--device", "cpu"]
    assert main([*words, "--json"]) == 0
    error = json.loads(capsys.readouterr().out)["bad.npz"]["prior"]
    assert error["strands"] == 55
    assert all(math.isfinite(value) for value in error.values())


def test_prior_traverse_draws_and_names_directions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prior-traverse", str(tmp_path / "out"), "--samples", "500", "--latents", "2", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "traversal.json").read_text())
    assert printed["directions"]["length"]["correlation"] > 0.7
    assert printed["directions"]["curliness"]["correlation"] > 0.4
    effects = [row["effect_mm"] for row in printed["latents_by_effect"]]
    assert effects == sorted(effects, reverse=True)
    for name in ("traversal", "samples", "interpolation"):
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train-prior", "prior.pt"], "expected a name that ends in .safetensors"),
        (["train-prior", "p.safetensors", "--head", "a.obj"], "--head: expected one per groom (0), found 1"),
        (["train-prior", "p.safetensors", "--minutes", "-1"], "--minutes: expected a number of at least 0, found -1."),
        (["train-prior", "p.safetensors", "--config.batch", "0"], "--config.batch: expected at least 2, found 0."),
        (["prior-report"], "expected at least one groom file, found none"),
        (["prior-report", "missing.hair"], "missing.hair"),
        (["prior-traverse", "out", "--weights", "missing.safetensors"], "found no file"),
    ],
)
def test_bad_input_is_one_sentence(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert len(printed.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (["prior-traverse", "OUT", "--latents", "-1"], "--latents"),
        (["prior-traverse", "OUT", "--seed", "-1"], "--seed"),
        (["prior-report", "groom.npz", "--curves", "-1"], "--curves"),
        (["prior-report", "groom.npz", "--optimise-steps", "-1"], "--optimise-steps"),
        (["synthesize", "OUT", "--seed", "-1"], "--seed"),
        (["synthesize", "OUT", "--samples", "0"], "--samples"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_impossible_numbers_are_one_sentence(words, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert capsys.readouterr().err.startswith(f"neural-strands: {option}: expected a whole number from ")
    assert list(tmp_path.iterdir()) == []
