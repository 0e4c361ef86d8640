"""Strands of grooms in local frames."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.frames import to_world
from neural_strands.geometry.strands import Strands, lengths
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior_training.groom_strands import local_strands
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import Roots, sample_roots


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
    with pytest.raises(InputError, match="at least 10 roots to fit a head to, found 3; give --head"):
        local_strands(few, None)
    stubs = roots.position[:, None] + torch.linspace(0, 0.001, 5)[:, None] * roots.normal[:, None]
    with pytest.raises(InputError, match="expected strands of at least 3 mm, found none"):
        local_strands(written(tmp_path, stubs), None)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory, roots: Roots) -> Path:
    """True strands in half millimetres and the head they grow on, as in a capture's folder."""
    folder = tmp_path_factory.mktemp("capture")
    local = synthetic_curves(300, torch.Generator().manual_seed(0))
    placed = to_world(local, roots.position, roots.frame)
    np.savez(folder / "ground_truth.npz", strands=(placed / 0.0005).numpy(), unit=np.float64(0.0005))
    head = mannequin()
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in head.mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in head.mesh.faces.tolist()]
    (folder / "head.obj").write_text("\n".join(lines))
    (folder / "scalp_faces.json").write_text(json.dumps(head.scalp_faces.tolist()))
    return folder


def test_true_strands_of_a_capture_stand_on_its_own_head(capture: Path) -> None:
    local = synthetic_curves(300, torch.Generator().manual_seed(0))
    found = local_strands(capture / "ground_truth.npz", None)
    torch.testing.assert_close(lengths(found), lengths(local), rtol=5e-3, atol=0)
    # Frames come from another chart than the mannequin's own, so they may be turned about the normal: heights are kept.
    torch.testing.assert_close(found[..., 2], local[..., 2], atol=0.002, rtol=0)
    assert torch.equal(local_strands(capture, None), found)


def test_a_head_that_is_given_takes_precedence_over_the_captures(capture: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"missing\.obj"):
        local_strands(capture, tmp_path / "missing.obj")


def test_a_capture_without_true_strands_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ground_truth\.npz: expected a groom file, found nothing there"):
        local_strands(tmp_path, None)
