"""The command around gsplat's trainer, with a stand-in that exports the points that it was given."""

import importlib.util
import itertools
import json

import pytest
import torch
from tiny_capture import cameras, true_segments, write_capture

from neural_strands.capture.colmap import read_colmap
from neural_strands.lmvs.files import save_segments

TRAINER = """
import struct, sys
from pathlib import Path

assert sys.argv[1] == "default"
words = sys.argv[2:]
options = {word[2:]: value for word, value in zip(words, words[1:]) if word.startswith("--")}
scene, out = Path(options["data-dir"]), Path(options["result-dir"])
steps = int(int(options["max-steps"]) * float(options["steps-scaler"]))
names = sorted(path.name for path in (scene / "images").iterdir())
(scene.parent / "photographs").write_text(" ".join(names))
rows = []
for line in (scene / "sparse" / "0" / "points3D.txt").read_text().splitlines():
    _, x, y, z, red, green, blue, _ = map(float, line.split())
    flat = [(value / 255 - 0.5) / 0.28209479 for value in (red, green, blue)]
    rows.append(struct.pack("<14f", x, y, z, *flat, 4.0, -5.3, -5.3, -5.3, 1.0, 0.0, 0.0, 0.0))
columns = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
columns += ["rot_0", "rot_1", "rot_2", "rot_3"]
header = ["ply", "format binary_little_endian 1.0", "element vertex %d" % len(rows)]
header += ["property float " + name for name in columns] + ["end_header", ""]
path = out / "ply" / ("point_cloud_%d.ply" % (steps - 1))
path.parent.mkdir(parents=True)
path.write_bytes("\\n".join(header).encode() + b"".join(rows))
"""


@pytest.fixture(scope="module")
def rival(benchmark_module):
    return benchmark_module("rivals", "gsplat_rival")


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """A capture of ten small views, two of them held out, segments of the others, and the trainer."""
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    save_segments(tmp_path / "segments.npz", true_segments(write_capture(tmp_path / "ball", views=10)))
    (tmp_path / "trainer.py").write_text(TRAINER)
    named = {name: tmp_path / path for name, path in (("capture", "ball"), ("out", "out"), ("trainer", "trainer.py"))}
    return {**named, "segments": tmp_path / "segments.npz", "hair_points": 1500, "head_points": 1500}


def test_what_is_missing_is_named(rival, asked, monkeypatch, capsys):
    def told(**changes):
        rival.main(rival.Arguments(**{**asked, **changes}))
        return json.loads(capsys.readouterr().out)["skipped"]

    find = importlib.util.find_spec
    monkeypatch.setattr(rival.importlib.util, "find_spec", lambda name: None if name == "gsplat" else find(name))
    assert told().startswith("gsplat: the package is not installed for ")
    monkeypatch.setattr(rival.importlib.util, "find_spec", lambda name: find("json" if name == "gsplat" else name))
    assert told(trainer=None) == "gsplat: no trainer is given (--trainer)"
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert told() == "gsplat: there is no GPU"
    assert not asked["out"].exists()


@pytest.mark.parametrize("iterations", [20, 6999, 7000, 30_000, 50_000])
def test_the_trainer_takes_as_many_steps_as_asked(rival, tmp_path, iterations):
    words = rival.trainer_words(tmp_path / "simple_trainer.py", tmp_path / "scene", tmp_path / "gsplat", iterations)
    values = dict(itertools.pairwise(words))
    # As `Config.adjust_steps` of the trainer.
    assert int(int(values["--max-steps"]) * float(values["--steps-scaler"])) == iterations
    assert int(int(values["--eval-steps"]) * float(values["--steps-scaler"])) > iterations
    assert {"--save-ply", "--disable-viewer", "--no-normalize-world-space"} <= set(words)


def test_splats_are_trained_drawn_and_scored_once(rival, asked, monkeypatch, capsys):
    monkeypatch.setattr(rival, "lacks", lambda _: None)
    arguments = rival.Arguments(**asked, iterations=40)
    rival.main(arguments)
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((asked["out"] / "result.json").read_text())
    assert result["splats"] == 3000
    # The hair is dark, so the trainer saw negatives; a ball of points of their colours looks like the ball.
    assert result["negative"]
    assert result["scores"]["mean"]["hair"]["psnr"] > 15
    names = (asked["out"] / "photographs").read_text().split()
    assert names == [*(f"{view:03d}.png" for view in (0, 1, 2, 3, 5, 6, 7, 8)), "0_000.png"]
    asked["trainer"].unlink()
    with pytest.raises(SystemExit, match="expected gsplat's trainer"):
        rival.main(arguments)
    asked["trainer"].write_text("raise SystemExit(3)")
    rival.main(arguments)
    with pytest.raises(SystemExit, match="other settings"):
        rival.main(rival.Arguments(**asked, iterations=41))


def test_a_model_is_what_colmap_reads(rival, benchmark_module, tmp_path, generator):
    scene, colmap = benchmark_module("rivals", "scene"), benchmark_module("rivals", "colmap_scene")
    seeds = scene.SeedPoints(torch.rand(5, 3, generator=generator), torch.rand(5, 3, generator=generator))
    written = list(cameras(3))
    colmap.write_colmap(tmp_path, written, seeds)
    (tmp_path / "images").mkdir()
    for camera in written:
        (tmp_path / "images" / camera.name).touch()
    for ours, view in zip(written, read_colmap(tmp_path, tmp_path / "sparse" / "0"), strict=True):
        torch.testing.assert_close(view.camera.world_to_camera, ours.world_to_camera, atol=1e-6, rtol=0)
        torch.testing.assert_close(view.camera.intrinsics, ours.intrinsics)
    model = pytest.importorskip("pycolmap").Reconstruction(str(tmp_path / "sparse" / "0"))
    assert len(model.images) == 3
    found = sorted((number, point) for number, point in model.points3D.items())
    places = torch.tensor([point.xyz.tolist() for _, point in found]).float()
    torch.testing.assert_close(places, seeds.points)
    assert [point.color.tolist() for _, point in found] == (255 * seeds.colours).round().int().tolist()
