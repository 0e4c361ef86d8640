"""How good the shipped prior is: on procedural coils always, on artists' grooms where they are available."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from neural_strands.geometry.frames import orthonormal_frames, to_local
from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.errors import reconstruction_error
from neural_strands.prior.pca import StrandPca
from neural_strands.prior.vae import StrandPrior, load_prior


@pytest.fixture(scope="module")
def prior() -> StrandPrior:
    return load_prior()


@pytest.fixture(scope="module")
def pca() -> StrandPca:
    generator = torch.Generator().manual_seed(0)
    return StrandPca.fit(torch.cat([synthetic_curves(1000, generator) for _ in range(6)]))


def coils(count: int = 500) -> torch.Tensor:
    """Coils of 3 to 8 mm radius and 15 to 40 mm pitch about bent bases of 10 to 25 cm: not drawn by prior.curves."""
    generator = torch.Generator().manual_seed(0)
    draw = torch.rand(count, 6, 1, generator=generator)
    t = torch.linspace(0, 1, 1500)[None]
    base, radius, pitch = 0.1 + 0.15 * draw[:, 0], 0.003 + 0.005 * draw[:, 1], 0.015 + 0.025 * draw[:, 2]
    bend = 1.5 * draw[:, 3]
    turn = 2 * math.pi * (base / pitch * t + draw[:, 4])
    grown = radius * (1 - torch.exp(-t * base / 0.01))
    # An arc of angle `bend` in the x-z plane; the coil winds about its tangent.
    angle = bend * t
    x = base / bend * (1 - angle.cos()) + grown * turn.cos() * angle.cos()
    z = base / bend * angle.sin() - grown * turn.cos() * angle.sin()
    curve = torch.stack([x, grown * turn.sin(), z], dim=-1)
    return resample_polyline_lengths(curve - curve[:, :1], 100)


def test_coils_are_kept_to_a_millimetre_and_better_than_by_pca(prior: StrandPrior, pca: StrandPca) -> None:
    strands = coils()
    error = reconstruction_error(prior.decode(prior.encode(strands)), strands)
    baseline = reconstruction_error(pca.decode(pca.encode(strands)), strands)
    assert error.mean_mm < 1.0
    assert error.mean_mm < baseline.mean_mm
    assert error.direction_deg < baseline.direction_deg


@pytest.mark.parametrize("name", ["sintel_bob", "straight_long"])
def test_artists_grooms_are_kept(prior: StrandPrior, pca: StrandPca, shared_data: Path, name: str) -> None:
    archive = np.load(shared_data / "captures" / name / "ground_truth.npz")
    points = torch.from_numpy(archive["strands"].astype(np.float32) * float(archive["unit"]))[::10]
    # Any frames will do here: outward from the middle of the roots.
    normal = points[:, 0] - points[:, 0].mean(dim=0)
    frames = orthonormal_frames(normal, torch.tensor([0.0, 1.0, 0.0]).expand_as(normal))
    strands = to_local(points, points[:, 0], frames)
    error = reconstruction_error(prior.decode(prior.encode(strands)), strands)
    baseline = reconstruction_error(pca.decode(pca.encode(strands)), strands)
    assert error.mean_mm < 0.5
    assert error.p95_mm < 2.0
    assert error.direction_deg < 5.0
    assert error.mean_mm < baseline.mean_mm + 0.3
    assert error.direction_deg < baseline.direction_deg + 3.0
