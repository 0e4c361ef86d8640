"""Strokes in a file, in space or on a view."""

import json
from pathlib import Path

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.strokes import lift_stroke, read_strokes

CAMERA = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 400.0, (200, 200), "front")


def wall() -> LineSegments:
    """Points on the plane z = 0.1, and as many behind it."""
    x, y = torch.meshgrid(torch.linspace(-0.1, 0.1, 41), torch.linspace(-0.1, 0.1, 41), indexing="ij")
    front = torch.stack([x, y, torch.full_like(x, 0.1)], dim=-1).reshape(-1, 3)
    points = torch.cat([front, front - torch.tensor([0.0, 0.0, 0.2])])
    down = torch.tensor([0.0, -1.0, 0.0]).repeat(len(points), 1)
    return LineSegments(points, down, torch.ones(len(points)), torch.arange(len(points)))


def test_a_stroke_on_a_view_is_lifted_to_what_it_sees_first(tmp_path: Path):
    truth = torch.tensor([[0.0, 0.05, 0.1], [0.02, 0.0, 0.1], [0.02, -0.05, 0.1]])
    pixels = CAMERA.project(truth)[0]
    path = tmp_path / "strokes.json"
    path.write_text(json.dumps([{"view": "front", "points": pixels.tolist()}, {"points": truth.tolist()}]))
    lifted, given = (lift_stroke(stroke, wall()) for stroke in read_strokes(path, [CAMERA]))
    assert torch.allclose(lifted, truth, atol=1e-4)
    assert torch.allclose(given, truth)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("no", "expected a list of strokes as JSON"),
        ("{}", "expected a list"),
        ("[5]", r"\[0\]: expected an object"),
        ("[" * 100_000, "nested too deeply"),
        ('[{"view": "front"}]', "a value under 'points'"),
        ('[{"points": [[0, 0, 0]]}]', r"\[0\]\.points: expected two or more points of 3"),
        ('[{"points": [[0, 0, 0], [1, 1]]}]', r"\[0\]\.points: expected finite numbers in lists of size any x 3"),
        ('[{"points": [[0, 0, 0], [1, 1, 1e300]]}]', "two or more points of 3 finite numbers"),
        ('[{"points": [[0, 0, 0], [1, 1, "2"]]}]', "finite numbers"),
        ('[{"view": ["front"], "points": [[0, 0], [1, 1]]}]', "expected a text"),
        ('[{"view": "back", "points": [[0, 0], [1, 1]]}]', "name of a view"),
        ('[{"view": "front", "points": [[0, 0], [1, 1]]}]', "points on the hair"),
    ],
)
def test_a_wrong_file_is_one_sentence(tmp_path: Path, content: str, message: str):
    path = tmp_path / "strokes.json"
    path.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        [lift_stroke(stroke, wall()) for stroke in read_strokes(path, [CAMERA])]
    assert str(caught.value).startswith(f"{path}: ")
    assert str(caught.value).isprintable()
