"""`fit` and `evaluate` through the command line, on a tiny capture."""

import io
import json
import math
import shutil
import zipfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import jaxtyping
import numpy as np
import pytest
import torch
from full_disk import smallest_files
from html_page import ReportPage
from tiny_capture import combed_strands, tiny_config, true_segments, write_capture

from neural_strands.cli.main import main
from neural_strands.evaluation.geometry_metrics import score_geometry
from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.fitting import config as fit_config
from neural_strands.geometry.strands import lengths
from neural_strands.grooms.io import read_groom
from neural_strands.lmvs.files import SegmentsSource, load_segments, load_segments_source, save_segments
from neural_strands.prior.vae import load_prior, save_prior
from neural_strands.runs.run_folder import FORMAT, RunFolder, read_description
from neural_strands.runs.run_log import LOSSES

SETTINGS = tiny_config(steps=8, initialise="mean")


@pytest.fixture(scope="module")
def made_capture(tmp_path_factory):
    """A folder with a capture and its segments."""
    folder = tmp_path_factory.mktemp("made_capture")
    save_segments(folder / "segments.npz", true_segments(write_capture(folder / "ball")))
    return folder


def shrink_presets(patch, folder):
    """Let every preset be the tiny settings, without weights of the perceptual loss."""
    patch.setenv("NEURAL_STRANDS_WEIGHTS", str(folder / "none"))
    patch.setattr(fit_config, "preset", lambda _: SETTINGS)


@pytest.fixture
def tiny(made_capture, tmp_path, monkeypatch):
    """A copy of that folder, and the presets shrunk to its size, without the time that first strands take."""
    shutil.copytree(made_capture, tmp_path, dirs_exist_ok=True)
    shrink_presets(monkeypatch, tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def made_run(made_capture, tmp_path_factory):
    """A finished run, beside a copy of its capture."""
    folder = tmp_path_factory.mktemp("made_run")
    shutil.copytree(made_capture, folder, dirs_exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        shrink_presets(patch, folder)
        patch.setattr(jaxtyping.config, "jaxtyping_disable", True)
        assert main(fit_arguments(folder)) == 0
    return folder / "run"


@pytest.fixture
def fitted(tiny, made_run, capsys):
    """`tiny` with a copy of that run."""
    shutil.copytree(made_run, tiny / "run")
    capsys.readouterr()
    return tiny


def fit_arguments(tiny, *more):
    return ["fit", str(tiny / "ball"), str(tiny / "run"), "--segments", str(tiny / "segments.npz"), *more]


def test_fit_then_evaluate_leave_a_groom_a_model_and_a_report(tiny, capsys, monkeypatch):
    monkeypatch.setattr("neural_strands.runs.run_fit.FORECAST_FROM", 8)
    assert main(fit_arguments(tiny, "--config.initialise", "flow")) == 0
    told = capsys.readouterr()
    assert "200 strands after 8 steps" in told.out
    assert "expect about" in told.err
    run, true_strands = tiny / "run", combed_strands()
    groom, arrays = read_groom(run / "groom.usd"), read_groom(run / "groom.npz")
    assert len(groom) == len(arrays) == 200
    torch.testing.assert_close(groom.vertices, arrays.vertices, atol=1e-6, rtol=0)
    assert arrays.root_uv is not None
    assert arrays.color is not None
    assert arrays.unseen is not None
    assert ((arrays.unseen >= 0) & (arrays.unseen <= 1)).all()
    rows = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    assert len(rows) == 8
    # Every loss has a label for people.
    assert {name for row in rows for name in row} - {"step", "seconds"} == set(LOSSES)
    assert main(["evaluate", str(run), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["held_out_views"]["count"] == 1
    assert figures["lmvs"]["1mm/10deg"]["precision"] > 95.0
    assert figures["unseen_strands_percent"] == pytest.approx(100 * float((arrays.unseen > 0.5).float().mean()))
    in_views = figures["strands_in_views_percent"]
    assert 0 <= in_views["direction"] <= 100
    assert 0 <= in_views["on_background"] < 50
    assert 0 <= in_views["mask_on_background"] < 50
    for threshold, chance in chance_scores(arrays, true_strands).items():
        assert 100 >= figures["strands"][threshold]["f_score"] > 2 * chance > 0, threshold
    assert figures["counts"] == {"strands": 200, "lmvs": len(true_strands)}
    long = figures["strand_lengths"]
    assert 0 < long["compared"] <= 200
    assert long["true_median_m"] == pytest.approx(float(lengths(true_strands).quantile(0.5)), rel=1e-3)
    assert long["median_ratio"] == pytest.approx(long["median_m"] / long["true_median_m"])
    page = (run / "report" / "index.html").read_text()
    assert page.count("data:image/png;base64,") >= 12
    assert "63.64" in page
    read = ReportPage(page)
    assert len(read.pictures) >= 12
    shown = dict(read.pictures[:3])
    photograph = cv2.imread(str(tiny / "ball" / "images" / "004.png"), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(shown["photograph"], photograph)
    assert shown["rendering of 004.png"].shape == photograph.shape
    assert shown["rendering of 004.png"].std() > 0
    strands = read.tables["Strands in the photographs"][2]
    assert list(in_views) == ["direction", "on_background", "mask_on_background"]
    assert strands == ["mean", *(f"{value:.1f}" for value in in_views.values())]
    mean = read.tables["Held-out views"][2]
    assert mean[:2] == ["mean", f"{figures['held_out_views']['psnr']:.2f}"]
    clean = figures["held_out_views"]["without_grain"]
    assert read.tables["Held-out views"][3][:2] == ["mean without grain", f"{clean['hair']['psnr']:.2f}"]
    assert clean["hair"]["psnr"] > figures["held_out_views"]["psnr"]
    rendering = torch.from_numpy(shown["rendering of 004.png"].copy()).double()
    error = (rendering - torch.from_numpy(photograph.copy()).double()).square().mean() / 255**2
    assert -10 * math.log10(error) == pytest.approx(clean["image"]["psnr"], abs=0.1)
    geometry = read.tables["Geometry compared with the true strands"]
    assert [row[0] for row in geometry[1:3]] == ["400 line segments (LMVS)", "200 fitted strands"]
    assert main(["evaluate", str(run)]) == 0
    told = capsys.readouterr().out.splitlines()
    for name, count in (("lmvs", "400 segments"), ("strands", "200 strands")):
        (line,) = (line for line in told if line.startswith(f"{name:8} 2mm/20deg"))
        assert line.endswith(f"F {figures[name]['2mm/20deg']['f_score']:6.2f} %  {count}")
    sentence = f"median {1e3 * long['median_m']:.1f} mm, {long['median_ratio']:.2f} times the true"
    assert any(line.startswith(f"lengths of strands: {sentence}") for line in told)
    assert sentence in page


def chance_scores(groom, true_strands):
    """F of straight strands from the fit's roots, with the true lengths, in random directions."""
    random = torch.Generator().manual_seed(0)
    heading = torch.nn.functional.normalize(torch.randn(len(groom), 1, 3, generator=random), dim=-1)
    reach = lengths(true_strands).mean() * torch.linspace(0, 1, 24)[:, None]
    scores = score_geometry(sample_strands(groom.roots[:, None] + reach * heading), sample_strands(true_strands))
    return {score.threshold.name: score.unsigned.f_score for score in scores if score.threshold.name != "1mm/10deg"}


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_fit_is_shown_on_a_page_only_if_asked(tiny, monkeypatch):
    shown = []

    @contextmanager
    def page(run):
        shown.append((run, (run / "groom.usd").exists()))
        yield
        shown.append((run, (run / "groom.usd").exists()))

    monkeypatch.setattr("neural_strands.viewer.beside.page_beside", page)
    assert main(fit_arguments(tiny, "--steps", "1")) == 0
    assert shown == []
    shutil.rmtree(tiny / "run")
    assert main(fit_arguments(tiny, "--steps", "1", "--view")) == 0
    # The page is there before the fit begins, and until it has ended.
    assert shown == [(tiny / "run", False), (tiny / "run", True)]


def test_a_run_among_the_photographs_is_refused(tiny, capsys):
    before = sorted(path.name for path in (tiny / "ball").iterdir())
    assert main(["fit", str(tiny / "ball"), str(tiny / "other" / ".." / "ball")]) == 2
    assert "expected another folder than the capture's, found the same" in capsys.readouterr().err
    assert sorted(path.name for path in (tiny / "ball").iterdir()) == before


def with_another_row(content: bytes) -> bytes:
    """A PNG of the same size with its first row changed; what follows its last chunk is ignored."""
    pixels = np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED), np.uint8)
    pixels = np.where(np.arange(len(pixels)).reshape(-1, *[1] * (pixels.ndim - 1)) == 0, pixels ^ 1, pixels)
    changed = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    assert len(changed) <= len(content)
    return changed.ljust(len(content), b"\0")


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_second_fit_into_the_same_folder_is_refused_and_nothing_is_lost(fitted, capsys):
    before = (fitted / "run" / "groom.npz").read_bytes()
    assert main(fit_arguments(fitted)) == 2
    assert "a run is there already" in capsys.readouterr().err
    assert (fitted / "run" / "groom.npz").read_bytes() == before


@pytest.mark.usefixtures("shapes_unchecked")
def test_resume_refuses_another_capture_and_other_settings(fitted, capsys):
    assert main(fit_arguments(fitted, "--resume", "--strands", "100")) == 2
    assert "began with strands = 200, found 100" in capsys.readouterr().err
    assert main(fit_arguments(fitted, "--resume", "--config.weights.alpha", "0.3")) == 2
    assert "began with weights.alpha = 0.5, found 0.3; give" in capsys.readouterr().err
    assert main(fit_arguments(fitted, "--resume", "--prior", str(other_prior(fitted)))) == 2
    assert "other weights of the strand prior" in capsys.readouterr().err
    changed = (
        fitted / "ball" / "images" / "000.png",
        fitted / "ball" / "masks" / "002.png",
        fitted / "ball" / "head.obj",
    )
    for path in changed:
        kept = path.read_bytes()
        # The files keep their sizes: one row of a picture changes, and one digit of a vertex.
        place = kept.index(b".", kept.index(b"\nv ")) + 3 if path.suffix == ".obj" else 0
        digit = kept[:place] + bytes([kept[place] ^ 1]) + kept[place + 1 :]
        path.write_bytes(digit if path.suffix == ".obj" else with_another_row(kept))
        assert main(fit_arguments(fitted, "--resume")) == 2, path
        assert "has changed since this run began" in capsys.readouterr().err
        path.write_bytes(kept)
    assert main(fit_arguments(fitted, "--resume")) == 0


@pytest.mark.usefixtures("shapes_unchecked")
def test_the_settings_of_stereo_are_part_of_the_run(fitted, capsys):
    stored = json.loads((fitted / "run" / "run.json").read_text())
    assert stored["config"]["stereo"]["confirming"] == 1.4
    assert stored["config"]["stereo"]["complete"] == "never"
    assert read_description(RunFolder(fitted / "run")).config == SETTINGS
    (fitted / "run" / "run.json").write_text(json.dumps(stored | {"format": 1}))
    capsys.readouterr()
    assert main(fit_arguments(fitted, "--resume")) == 2
    assert_one_sentence(capsys, f"format: expected {FORMAT}, found 1; use the version of neural-strands that wrote it")


@pytest.mark.usefixtures("shapes_unchecked")
def test_settings_from_a_file_reach_the_run_and_its_figures_are_printed_as_json(tiny, capsys):
    (tiny / "settings.toml").write_text("steps = 6\n[weights]\nhead = 2.0\n")
    words = fit_arguments(tiny, "--config", str(tiny / "settings.toml"), "--config.weights.alpha", "0.3", "--seed", "7")
    assert main([*words, "--steps", "2", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    stored = read_description(RunFolder(tiny / "run")).config
    weights = replace(SETTINGS.weights, head=2.0, alpha=0.3)
    assert stored == replace(SETTINGS, steps=2, seed=7, weights=weights)
    assert figures["strands"] == len(read_groom(Path(figures["files"]["groom"]))) == 200
    last = json.loads(Path(figures["files"]["log"]).read_text().splitlines()[-1])
    assert (figures["steps"], figures["last_step"]) == (2, last)
    again = [*words[:2], str(tiny / "again"), *words[3:5], "--config", str(tiny / "run" / "run.json")]
    assert main(again) == 0
    assert read_description(RunFolder(tiny / "again")).config == stored
    ours, theirs = (read_groom(tiny / name / "groom.npz") for name in ("run", "again"))
    assert torch.equal(ours.vertices, theirs.vertices)


def other_prior(tiny):
    prior = load_prior()
    with torch.no_grad():
        prior.generator.linear.bias.add_(0.01)
    save_prior(prior, tiny / "other.safetensors", {})
    return tiny / "other.safetensors"


def test_without_a_head_there_is_one_sentence(tiny, capsys):
    (tiny / "ball" / "head.obj").unlink()
    assert main(fit_arguments(tiny)) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "--head" in told
    assert not (tiny / "run").exists()


def test_two_views_are_refused_in_one_sentence_and_leave_no_run(tiny, capsys):
    path = tiny / "ball" / "transforms.json"
    plain = json.loads(path.read_text())
    path.write_text(json.dumps(plain | {"frames": plain["frames"][:2]}))
    for arguments in (fit_arguments(tiny), fit_arguments(tiny)[:3]):
        assert main(arguments) == 2
        assert_one_sentence(capsys, "at least 3 training views, found 2")
    assert not (tiny / "run").exists()


def test_segments_that_are_absent_empty_or_of_another_head_leave_no_run(tiny, capsys):
    whole = load_segments(tiny / "segments.npz")
    save_segments(tiny / "segments.npz", whole.select(torch.arange(0)))
    assert main(fit_arguments(tiny)) == 2
    assert_one_sentence(capsys, "segment points or more, found 0")
    save_segments(tiny / "segments.npz", replace(whole, points=whole.points + 2.0))
    assert main(fit_arguments(tiny)) == 2
    assert_one_sentence(capsys, "align or scale it")
    (tiny / "segments.npz").unlink()
    assert main(fit_arguments(tiny)) == 2
    assert_one_sentence(capsys, "segments.npz")
    assert not (tiny / "run").exists()


@pytest.mark.usefixtures("shapes_unchecked")
def test_segments_made_with_held_out_views_leave_no_run_and_unnamed_views_are_warned_of(tiny, capsys):
    path = tiny / "segments.npz"
    segments, names = load_segments(path), [f"{k:03d}.png" for k in range(6)]
    save_segments(path, segments, SegmentsSource(tuple(names)))
    assert main(fit_arguments(tiny)) == 2
    assert_one_sentence(capsys, "found 1 of these 1 among them, 004.png first; run lmvs with --hold-out-every 5")
    assert not (tiny / "run").exists()
    source = SegmentsSource((*names[:4], names[5]), {"seed": 3})
    save_segments(path, segments, source)
    assert main(fit_arguments(tiny, "--steps", "1")) == 0
    assert "warning" not in capsys.readouterr().err
    assert load_segments_source(tiny / "run" / "segments.npz") == source
    save_segments(path, segments)
    assert main([*fit_arguments(tiny)[:2], str(tiny / "old"), *fit_arguments(tiny)[3:], "--steps", "1"]) == 0
    assert "does not name the views" in capsys.readouterr().err


@pytest.mark.usefixtures("shapes_unchecked")
def test_damaged_segments_leave_no_run(tiny, capsys):
    """NaN in one point of given segments, and files on which numpy's reader fails with various exceptions."""
    path = tiny / "segments.npz"
    whole = load_segments(path)
    points = whole.points.clone()
    points[7, 1] = torch.nan
    content = path.read_bytes()
    save_segments(path, replace(whole, points=points))
    damaged = {"finite numbers in points": path.read_bytes(), "broken": content[:-100], "line segments": b""}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        for name in ("points", "directions", "confidence", "segment_id"):
            archive.writestr(f"{name}.npy", zipfile.ZipFile(io.BytesIO(content)).read(f"{name}.npy"))
    damaged["stored or deflated"] = path.read_bytes()
    for words, damage in damaged.items():
        path.write_bytes(damage)
        assert main(fit_arguments(tiny)) == 2
        assert_one_sentence(capsys, words)
        assert not (tiny / "run").exists()
    path.write_bytes(content)
    assert main(fit_arguments(tiny, "--steps", "1")) == 0


@pytest.mark.usefixtures("shapes_unchecked")
def test_evaluate_finds_the_capture_that_was_fitted_and_no_other(tiny, capsys, monkeypatch):
    (tiny / "here").mkdir()
    (tiny / "ball").rename(tiny / "here" / "ball")
    monkeypatch.chdir(tiny / "here")
    assert main(["fit", "ball", "run", "--segments", str(tiny / "segments.npz")]) == 0
    monkeypatch.chdir(tiny)
    assert main(["evaluate", "here/run", "--json"]) == 0
    # If both are moved, the run finds the capture; if it is moved alone, it does not.
    (tiny / "here").rename(tiny / "there")
    assert main(["evaluate", "there/run", "--json"]) == 0
    capsys.readouterr()
    (tiny / "there" / "run").rename(tiny / "run")
    assert main(["evaluate", "run"]) == 2
    assert_one_sentence(capsys, "move run and capture together")
    (tiny / "run").rename(tiny / "there" / "run")
    path = tiny / "there" / "ball" / "transforms.json"
    kept = path.read_text()
    plain = json.loads(kept)
    path.write_text(json.dumps(plain | {"frames": plain["frames"][:3]}))
    assert main(["evaluate", "there/run"]) == 2
    assert_one_sentence(capsys, "has changed since it was fitted")
    path.write_text(kept)
    described = tiny / "there" / "run" / "run.json"
    kept = described.read_text()
    stored = json.loads(kept)
    for changes, words in (
        ({"format": 99}, "use the version of neural-strands that wrote it"),
        ({"format": None}, "a value under 'format'"),
        ({"capture": 5}, "capture: expected a text"),
        ({"config": stored["config"] | {"steps": "many"}}, "config.steps: expected a whole number"),
        ({"config": stored["config"] | {"surprise": 1}}, "config.surprise: expected a setting"),
    ):
        described.write_text(json.dumps(stored | changes))
        assert main(["evaluate", "there/run"]) == 2
        assert_one_sentence(capsys, words)
    described.write_text("[" * 100_000)
    assert main(["evaluate", "there/run"]) == 2
    assert_one_sentence(capsys, "nested too deeply")


def assert_one_sentence(capsys, words):
    told = [line for line in capsys.readouterr().err.splitlines() if "structural loss" not in line]
    assert len(told) == 1, told
    assert words in told[0]


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_full_disk_ends_a_fit_in_one_sentence_and_the_last_checkpoint_stays(fitted, capsys, monkeypatch):
    checkpoint, groom = fitted / "run" / "checkpoint.pt", fitted / "run" / "groom.npz"
    before = {path: path.read_bytes() for path in (checkpoint, groom)}
    with smallest_files(10_000):
        assert main(fit_arguments(fitted, "--resume")) == 2
    told = capsys.readouterr().err.splitlines()
    assert "checkpoint.pt: cannot be written (File too large)" in told[-1]
    assert not any("Traceback" in line for line in told)
    assert {path: path.read_bytes() for path in before} == before
    assert not [path for path in (fitted / "run").iterdir() if path.name.startswith(".")]
    assert main(fit_arguments(fitted, "--resume")) == 0
