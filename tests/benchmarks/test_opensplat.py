"""The command around OpenSplat, with a stand-in program that exports the points that it was given."""

import json
import stat
import sys

import pytest
from tiny_capture import true_segments, write_capture

from neural_strands.lmvs.files import save_segments

PROGRAM = """#!{python}
import struct, sys
from pathlib import Path

words = sys.argv[1:]
scene, out, steps = Path(words[0]), Path(words[words.index("-o") + 1]), words[words.index("--num-iters") + 1]
assert "--cpu" in words and "--keep-crs" in words
calls = scene.parent / "calls"
calls.write_text((calls.read_text() if calls.exists() else "") + steps + " ")
if (scene.parent / "broken").exists():
    sys.exit(3)
head, body = (scene / "points.ply").read_bytes().split(b"end_header\\n", 1)
names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
names += ["rot_0", "rot_1", "rot_2", "rot_3"]
rows = []
for x, y, z, red, green, blue in struct.iter_unpack("<fffBBB", body):
    flat = [(value / 255 - 0.5) / 0.28209479 for value in (red, green, blue)]
    rows.append(struct.pack("<14f", x, y, z, *flat, 4.0, -5.3, -5.3, -5.3, 1.0, 0.0, 0.0, 0.0))
header = ["ply", "format binary_little_endian 1.0", "element vertex %d" % len(rows)]
header += ["property float " + name for name in names] + ["end_header", ""]
out.write_bytes("\\n".join(header).encode() + b"".join(rows))
"""


@pytest.fixture(scope="module")
def opensplat(benchmark_module):
    return benchmark_module("rivals", "opensplat")


@pytest.fixture
def asked(opensplat, tmp_path, monkeypatch):
    """A capture of ten small views, two of them held out, segments of the others, and the program."""
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    strands = write_capture(tmp_path / "ball", views=10)
    save_segments(tmp_path / "segments.npz", true_segments(strands))
    program = tmp_path / "program"
    program.write_text(PROGRAM.format(python=sys.executable))
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    return {
        "capture": tmp_path / "ball",
        "out": tmp_path / "out",
        "program": program,
        "segments": tmp_path / "segments.npz",
        "hair_points": 1500,
        "head_points": 1500,
    }


def calls(asked):
    return (asked["out"] / "calls").read_text().split()


def test_splats_are_trained_drawn_and_scored_once(opensplat, asked, capsys):
    opensplat.main(opensplat.Arguments(**asked, iterations=40))
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((asked["out"] / "result.json").read_text())
    assert result["splats"] == 3000
    assert result["iterations"] == 40
    assert result["processor_minutes"] > 0
    assert [view["name"] for view in result["scores"]["views"]] == ["004.png", "009.png"]
    # A ball of points of the photographs' colours looks like the ball.
    assert result["scores"]["mean"]["hair"]["psnr"] > 15
    assert {path.name for path in (asked["out"] / "scene" / "images").iterdir()} == {
        f"{k:03d}.png" for k in range(10) if k not in (4, 9)
    }
    opensplat.main(opensplat.Arguments(**asked, iterations=40))
    assert calls(asked) == ["40"]
    with pytest.raises(SystemExit, match="other settings"):
        opensplat.main(opensplat.Arguments(**asked, iterations=41))


def test_minutes_become_iterations_and_some_views_are_shown(opensplat, asked, monkeypatch):
    monkeypatch.setattr(opensplat, "settings", lambda iterations, views: ["--num-iters", str(iterations + views)])
    opensplat.main(opensplat.Arguments(**asked, minutes=1e-6, training=(0, 2, 5, 7)))
    assert calls(asked) == [str(opensplat.PILOT + 4)] * 2
    shown = sorted(path.stem for path in (asked["out"] / "scene" / "images").iterdir())
    assert shown == ["000", "002", "005", "007"]
    with pytest.raises(SystemExit, match="found 4; leave it out"):
        opensplat.main(opensplat.Arguments(**asked, minutes=1e-6, training=(3, 4)))


def test_what_fails_leaves_nothing_that_counts_as_finished(opensplat, asked):
    with pytest.raises(SystemExit, match="expected either"):
        opensplat.main(opensplat.Arguments(**asked))
    with pytest.raises(SystemExit, match="expected OpenSplat's program"):
        opensplat.main(opensplat.Arguments(**{**asked, "program": asked["out"] / "none"}, iterations=5))
    asked["out"].mkdir()
    (asked["out"] / "broken").touch()
    with pytest.raises(SystemExit, match="ended with status 3"):
        opensplat.main(opensplat.Arguments(**asked, iterations=5))
    (asked["out"] / "broken").unlink()
    opensplat.main(opensplat.Arguments(**asked, iterations=5))
    assert calls(asked) == ["5", "5"]


def test_intervals_shrink_with_the_run(opensplat):
    def read(iterations):
        words = opensplat.settings(iterations, 32)
        return dict(zip((word[2:] for word in words[::2]), map(int, words[1::2]), strict=True))

    whole, short = read(30_000), read(3_000)
    assert whole["resolution-schedule"] == 3000
    assert whole["refine-every"] == 100
    assert "reset-alpha-every" not in whole
    assert short["resolution-schedule"] == 300
    assert short["sh-degree-interval"] == 100
    assert short["reset-alpha-every"] * short["refine-every"] > 3000
