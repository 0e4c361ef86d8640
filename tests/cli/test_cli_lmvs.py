"""`lmvs` through the command line, on a tiny capture: results, restart, strokes and bad input."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from tiny_capture import RADIUS, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.cli.main import main
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.stereo import find_segments
from neural_strands.foundation.progress import untracked
from neural_strands.lmvs.files import load_segments, load_segments_source
from neural_strands.lmvs.reconstruct import LmvsConfig


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    """A ball with combed hair, seen from all around."""
    write_capture(tmp_path / "ball", views=16)
    return tmp_path / "ball"


def stamps(out: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (out / "work").glob("*.npz")}


def test_segments_pictures_and_a_restart_that_computes_no_view_again(ball, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["lmvs", str(ball), str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = load_segments(out / "segments.npz")
    assert told["points"] == len(found) > 100
    assert told["segments"] == found.segment_count
    distance = found.points.norm(dim=-1)
    # A pixel covers 4 mm here.
    assert ((distance - RADIUS).abs() < 0.02).float().mean() > 0.9
    assert torch.allclose(found.directions.norm(dim=-1), torch.ones(len(found)), atol=1e-4)
    names = {path.name.split("_")[0] for path in (out / "report").iterdir()}
    assert names == {"orientation", "depth", "segments"}
    before = stamps(out)
    assert len(before) == 32
    assert main(["lmvs", str(ball), str(out)]) == 0
    assert stamps(out) == before
    again = load_segments(out / "segments.npz")
    assert torch.equal(again.points, found.points)
    # A view whose result is missing is computed again, to the same bits.
    lost = next((out / "work").glob("lines_0003_*.npz"))
    content = {name: value.copy() for name, value in np.load(lost).items()}
    lost.unlink()
    assert main(["lmvs", str(ball), str(out)]) == 0
    assert all(np.array_equal(content[name], value) for name, value in np.load(lost).items())
    assert len([name for name, stamp in stamps(out).items() if before[name] != stamp]) == 1


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_damaged_result_of_a_view_is_one_sentence_that_names_it(ball, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["lmvs", str(ball), str(out), "--views", *map(str, range(0, 16, 3))]) == 0
    capsys.readouterr()
    for kind in ("features", "lines"):
        path = next((out / "work").glob(f"{kind}_0001_*.npz"))
        kept = path.read_bytes()
        path.write_bytes(kept[: len(kept) // 2])
        assert main(["lmvs", str(ball), str(out), "--views", *map(str, range(0, 16, 3))]) == 2
        told = capsys.readouterr().err.splitlines()
        assert path.name in told[-1]
        assert told[-1].endswith("remove the file, so that the view is computed again.")
        path.unlink()
    assert main(["lmvs", str(ball), str(out), "--views", *map(str, range(0, 16, 3))]) == 0


@pytest.mark.usefixtures("shapes_unchecked")
def test_another_seed_or_photograph_starts_anew_and_says_so(ball, tmp_path, caplog):
    out = tmp_path / "out"
    words = ["lmvs", str(ball), str(out), "--views", *map(str, range(6))]
    assert main(words) == 0
    assert "other photographs or settings" not in caplog.text
    before = stamps(out)
    assert main([*words, "--seed", "1"]) == 0
    assert caplog.text.count("other photographs or settings") == 1
    middle = stamps(out)
    assert all(middle[name] != stamp for name, stamp in before.items())
    picture = ball / "images" / "004.png"
    cv2.imwrite(str(picture), cv2.imread(str(picture)) // 2)
    assert main([*words, "--seed", "1"]) == 0
    assert caplog.text.count("other photographs or settings") == 2
    assert all(stamps(out)[name] != stamp for name, stamp in middle.items())


@pytest.mark.usefixtures("shapes_unchecked")
def test_strokes_turn_segments_without_computing_views_again(ball, tmp_path):
    out = tmp_path / "out"
    assert main(["lmvs", str(ball), str(out)]) == 0
    down, before = load_segments(out / "segments.npz"), stamps(out)
    # Strokes that run upwards, all around.
    strokes = []
    for azimuth in np.linspace(0, 2 * np.pi, 24, endpoint=False):
        polar = np.linspace(1.6, 0.3, 20)
        ring = [np.sin(polar) * np.sin(azimuth), np.cos(polar), np.sin(polar) * np.cos(azimuth)]
        strokes.append({"points": ((RADIUS + 0.005) * np.stack(ring, axis=1)).tolist()})
    (tmp_path / "up.json").write_text(json.dumps(strokes))
    assert main(["lmvs", str(ball), str(out), "--strokes", str(tmp_path / "up.json")]) == 0
    up = load_segments(out / "segments.npz")
    assert stamps(out) == before
    assert float(down.directions[:, 1].mean()) < -0.1
    assert float(up.directions[:, 1].mean()) > 0.1


def test_views_that_cannot_help_are_named_and_the_others_count(ball, tmp_path, caplog):
    cv2.imwrite(str(ball / "masks" / "002.png"), np.zeros((64, 64), np.uint8))
    for name, level in (("005", 0), ("009", 255)):
        cv2.imwrite(str(ball / "images" / f"{name}.png"), np.full((64, 64, 3), level, np.uint8))
    assert main(["lmvs", str(ball), str(tmp_path / "out")]) == 0
    told = caplog.text
    assert "002" in told
    assert "no hair found" in told
    for name in ("005", "009"):
        assert name in told
    assert told.count("no texture") == 2
    assert len(load_segments(tmp_path / "out" / "segments.npz")) > 100


def test_hair_is_found_without_masks(tmp_path):
    write_capture(tmp_path / "bare", views=16, with_masks=False)
    assert main(["lmvs", str(tmp_path / "bare"), str(tmp_path / "out")]) == 0
    found = load_segments(tmp_path / "out" / "segments.npz")
    assert ((found.points.norm(dim=-1) - RADIUS).abs() < 0.03).float().mean() > 0.5


@pytest.mark.usefixtures("shapes_unchecked")
def test_held_out_views_are_left_out_and_the_file_names_the_others(ball, tmp_path):
    out = tmp_path / "out"
    assert main(["lmvs", str(ball), str(out), "--hold-out-every", "5"]) == 0
    source = load_segments_source(out / "segments.npz")
    assert source is not None
    kept = [index for index in range(16) if index not in (4, 9, 14)]
    assert source.views == tuple(Capture.load(ball).cameras[index].name for index in kept)
    assert source.settings["stereo"]["confirming"] == LmvsConfig().confirming
    before, found = stamps(out), load_segments(out / "segments.npz")
    named = [str(index) for index in kept]
    assert main(["lmvs", str(ball), str(out), "--hold-out-every", "5", "--views", "4", *named]) == 0
    assert stamps(out) == before
    assert torch.equal(load_segments(out / "segments.npz").points, found.points)


def test_complete_fills_gaps_between_the_same_chains(ball, tmp_path):
    assert main(["lmvs", str(ball), str(tmp_path / "out"), "--complete", "never"]) == 0
    sure, before = load_segments(tmp_path / "out" / "segments.npz"), stamps(tmp_path / "out")
    assert main(["lmvs", str(ball), str(tmp_path / "out"), "--complete", "always"]) == 0
    full = load_segments(tmp_path / "out" / "segments.npz")
    assert stamps(tmp_path / "out") == before
    assert full.segment_count > sure.segment_count
    added = full.segment_id >= sure.segment_count
    assert (torch.bincount(full.segment_id[added])[sure.segment_count :] == 2).all()
    assert (full.confidence[added] < 0.2).all()


@pytest.mark.usefixtures("shapes_unchecked")
def test_fewer_confirming_views_find_more_and_give_what_a_fit_finds(ball, tmp_path):
    out, options = tmp_path / "out", ["--complete", "never"]
    assert main(["lmvs", str(ball), str(out), *options]) == 0
    sure, before = load_segments(out / "segments.npz"), stamps(out)
    assert main(["lmvs", str(ball), str(out), *options, "--confirming", "1.4"]) == 0
    more = load_segments(out / "segments.npz")
    assert stamps(out) == before
    assert len(more) > len(sure)
    capture = Capture.load(ball)
    fitted = find_segments(capture, find_head(capture), FitConfig(), None, untracked)
    assert torch.equal(more.points, fitted.points)
    assert torch.equal(more.directions, fitted.directions)


def test_refusals_are_one_sentence(ball, tmp_path, capsys):
    assert main(["lmvs", str(ball), str(tmp_path / "one"), "--views", "3"]) == 2
    assert "at least two views" in capsys.readouterr().err
    assert main(["lmvs", str(ball), str(tmp_path / "one"), "--views", "3", "16"]) == 2
    assert "--views: expected numbers from 0 to 15, found 16." in capsys.readouterr().err
    assert main(["lmvs", str(tmp_path / "none"), str(tmp_path / "two")]) == 2
    assert "none" in capsys.readouterr().err
    assert main(["lmvs", str(ball), str(tmp_path / "two"), "--up", "0", "0", "0"]) == 2
    assert "--up: expected three finite numbers" in capsys.readouterr().err
    vertices = (ball / "head.obj").read_text().splitlines()
    scaled = [
        "v " + " ".join(str(1000 * float(x)) for x in line.split()[1:4]) if line.startswith("v ") else line
        for line in vertices
    ]
    (ball / "head.obj").write_text("\n".join(scaled) + "\n")
    assert main(["lmvs", str(ball), str(tmp_path / "three")]) == 2
    assert "wrong scale: expected a head in metres" in capsys.readouterr().err
    assert main(["lmvs", str(ball), str(tmp_path / "two"), "--size", "7"]) == 2
    assert "--size: expected 32 pixels or more, found 7" in capsys.readouterr().err
