"""Strands of grooms in local frames."""

from pathlib import Path

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.frames import to_world
from neural_strands.geometry.strands import Strands, lengths
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.prior.curves import synthetic_curves
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import Roots, sample_roots
from neural_strands.training.groom_strands import local_strands


@pytest.fixture(scope="module")
def roots() -> Roots:
    return sample_roots(mannequin(), 300, torch.Generator().manual_seed(0))


def written(folder: Path, points: torch.Tensor) -> Path:
    write_groom(folder / "groom.npz", Groom.from_strands(Strands(points)))
    return folder / "groom.npz"


def test_local_strands_are_those_that_were_placed(tmp_path: Path, roots: Roots) -> None:
    local = synthetic_curves(300, torch.Generator().manual_seed(0))
    path = written(tmp_path, to_world(local, roots.position, roots.frame))
    found = local_strands(path, None)
    # The mannequin is fitted to its own roots: it comes back to within a few millimetres and degrees.
    assert found.shape == local.shape
    torch.testing.assert_close(lengths(found), lengths(local), rtol=0.05, atol=0)
    gap = (found - local).norm(dim=-1).mean(dim=1) / lengths(local)
    assert gap.median() < 0.1


def test_units_are_found_from_the_roots(tmp_path: Path, roots: Roots) -> None:
    local = synthetic_curves(300, torch.Generator().manual_seed(0))
    path = written(tmp_path, 100 * to_world(local, roots.position, roots.frame))
    torch.testing.assert_close(lengths(local_strands(path, None)), lengths(local), rtol=0.05, atol=0)


def test_useless_grooms_are_refused(tmp_path: Path, roots: Roots) -> None:
    few = written(tmp_path, synthetic_curves(3, torch.Generator().manual_seed(0)))
    with pytest.raises(InputError, match="at least 10 roots to fit a head to, got 3; give --head"):
        local_strands(few, None)
    stubs = roots.position[:, None] + torch.linspace(0, 0.001, 5)[:, None] * roots.normal[:, None]
    with pytest.raises(InputError, match="expected strands of at least 3 mm, found none"):
        local_strands(written(tmp_path, stubs), None)
