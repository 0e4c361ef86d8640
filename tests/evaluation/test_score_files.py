"""What is scored: units are checked before anything is sampled, and samples are bounded."""

import numpy as np
import pytest
import torch

from neural_strands.evaluation import score_files
from neural_strands.evaluation.score_files import read_oriented_points
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.lmvs.files import save_segments


@pytest.fixture
def strands() -> torch.Tensor:
    """Ten strands of ten centimetres, on a row of nine."""
    x, y = torch.meshgrid(torch.arange(10) * 0.01, torch.linspace(0, -0.1, 11), indexing="ij")
    return torch.stack([x, y, torch.zeros_like(x)], dim=-1)


def write(folder, strands, kind):
    if kind == "ground truth":
        np.savez(folder / "ground_truth.npz", strands=strands.numpy())
        return folder
    if kind == "segments":
        down = torch.tensor([0.0, -1.0, 0.0]).expand(110, 3)
        ids = torch.arange(10).repeat_interleave(11)
        save_segments(folder / "a.npz", LineSegments(strands.reshape(-1, 3), down, torch.ones(110), ids))
        return folder / "a.npz"
    write_groom(folder / "a.hair", Groom.from_strands(Strands(strands)))
    return folder / "a.hair"


@pytest.mark.parametrize("kind", ["groom", "ground truth", "segments"])
def test_metres_are_sampled_and_centimetres_refused_before(tmp_path, strands, monkeypatch, kind):
    sampled = read_oriented_points(write(tmp_path, strands, kind))
    assert len(sampled) == pytest.approx(10 * 201, abs=10)

    def sample(*_):
        raise AssertionError("sampled before the unit was checked")

    for name in ("sample_curves", "sample_strands", "sample_segments"):
        monkeypatch.setattr(score_files, name, sample)
    with pytest.raises(InputError, match="expected hair in metres, found something 10 across; convert it first"):
        read_oriented_points(write(tmp_path, 100 * strands, kind))


def test_samples_are_bounded(tmp_path, strands):
    path = write(tmp_path, strands, "groom")
    with pytest.raises(InputError, match=r"a\.hair: expected curves of at most 200000000 samples, found 10"):
        read_oriented_points(path, 1e-10)


def test_a_capture_without_truth(tmp_path):
    with pytest.raises(InputError, match=r"ground_truth\.npz"):
        read_oriented_points(tmp_path)
