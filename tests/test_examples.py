"""The scripts in examples/ run on a small capture and leave what they promise."""

import os
import re
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
import torch
from tiny_capture import tiny_config

import neural_strands as ns
from neural_strands.fitting import config as fit_config
from neural_strands.geometry.strands import lengths

FOLDER = Path(__file__).resolve().parents[1] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))


def main_of(name):
    return runpy.run_path(str(FOLDER / name))["main"]


def test_groom_formats(made_workspace, tmp_path, capsys):
    outputs = [tmp_path / f"hair.{suffix}" for suffix in ("ply", "usda", "npz")]
    main_of("01_groom_formats.py")(made_workspace / "run" / "groom.npz", 12, *outputs)
    assert "200 strands of 24 to 24 points" in capsys.readouterr().out
    expected = ns.read_groom(made_workspace / "run" / "groom.npz").strands(12).points
    for path in outputs:
        found = ns.read_groom(path).strands(None).points
        torch.testing.assert_close(found, expected, atol=1e-6, rtol=0)


def test_capture_to_groom(workspace, monkeypatch, capsys):
    monkeypatch.setattr(fit_config, "preset", lambda _: replace(tiny_config(), initialise="mean"))
    main_of("02_capture_to_groom.py")(workspace / "capture", workspace / "new", steps=2, alpha=0.25)
    told = capsys.readouterr().out
    segments, strands = (int(found) for found in re.findall(r": (\d+) s", told))
    assert segments > 100
    assert strands == len(ns.read_groom(workspace / "new" / "groom.usd")) == 200


def test_render_turntable(made_workspace, tmp_path):
    main_of("03_render_turntable.py")(made_workspace / "run", tmp_path / "pictures", frames=2, size=48)
    pictures = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((tmp_path / "pictures").iterdir())]
    assert len(pictures) == 2
    for picture in pictures:
        assert picture is not None
        assert picture.shape == (48, 48, 4)
        # Hair in the middle, none in the corner.
        assert picture[0, 0, 3] < picture[..., 3].max()


def test_score_strands(made_workspace, capsys):
    main_of("04_score_strands.py")(made_workspace / "segments.npz", made_workspace / "capture")
    rows = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in rows[1:]] == ["1mm/10deg", "2mm/20deg", "3mm/30deg", "4mm/40deg"]
    assert all(float(row.split()[1]) > 90 for row in rows[1:])


def test_own_loss(workspace, capsys):
    main_of("05_own_loss.py")(workspace / "run", length=0.06, steps=30)
    before, after = (ns.read_groom(workspace / "run" / f"{name}.usd").strands(None) for name in ("before", "after"))
    error = [float((lengths(strands.points) - 0.06).abs().mean()) for strands in (before, after)]
    assert error[1] < 0.5 * error[0]
    told = [float(found) for found in re.findall(r"off by ([\d.]+) m", capsys.readouterr().out)]
    assert told[0] == pytest.approx(error[0], abs=1e-4)


@pytest.mark.slow
def test_blend_hair(made_workspace, tmp_path):
    assert callable(main_of("06_blend_hair.py"))
    python = os.environ.get("NEURAL_STRANDS_BLENDER")
    if python is None:
        pytest.skip("NEURAL_STRANDS_BLENDER names no Python with bpy")
    groom = ns.read_groom(made_workspace / "run" / "groom.npz")
    red, thick = torch.tensor([0.8, 0.05, 0.02]).expand(200, 3), torch.full((len(groom.vertices),), 2e-3)
    ns.write_groom(tmp_path / "hair.usd", replace(groom, color=red, width=thick))
    files = [tmp_path / f"hair.{suffix}" for suffix in ("usd", "blend", "png")]
    subprocess.run([python, FOLDER / "06_blend_hair.py", *files], capture_output=True, timeout=300, check=True)
    assert files[1].stat().st_size > 10_000
    picture = cv2.imread(str(files[2]))
    assert picture is not None
    assert picture.shape == (400, 400, 3)
    # The hair is red, the sky grey.
    blue, _, glow = picture.astype(int).transpose(2, 0, 1)
    assert 50 < int((glow - blue > 40).sum()) < 0.5 * 400 * 400
    assert abs(int(glow[0, 0] - blue[0, 0])) < 10


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_each_is_short_listed_and_tested(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    assert f"[{path.name}]({path.name})" in (FOLDER / "README.md").read_text(encoding="utf-8")
    assert f'main_of("{path.name}")' in Path(__file__).read_text(encoding="utf-8")


def test_a_script_explains_its_arguments():
    shown = subprocess.run(
        [sys.executable, SCRIPTS[0], "--help"], capture_output=True, text=True, timeout=300, check=True
    )
    assert "the suffix chooses the format" in " ".join(shown.stdout.split())
