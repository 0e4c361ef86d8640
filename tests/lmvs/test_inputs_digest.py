"""Stored results are reused only for the same photographs, head and settings."""

import logging
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import View, Views
from neural_strands.lmvs.inputs_digest import inputs_digest
from neural_strands.lmvs.orientation import OrientationConfig
from neural_strands.lmvs.view_cache import ViewCache

CAMERA = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 40.0, (24, 24), "front")
IMAGE = torch.linspace(0, 1, 24 * 24 * 3).reshape(24, 24, 3)
MASK = torch.ones(24, 24)
HEAD = Mesh(torch.eye(3), torch.tensor([[0, 1, 2]]))


def view(image: torch.Tensor = IMAGE, mask: torch.Tensor = MASK, camera: Camera = CAMERA) -> View:
    return View(camera, image, mask)


def test_the_same_inputs_have_one_digest_and_any_change_another():
    changed = IMAGE.clone()
    changed[3, 4, 1] += 1e-3
    moved = replace(CAMERA, world_to_camera=CAMERA.world_to_camera + 1e-4)
    digests = [
        inputs_digest(Views.in_memory([view()]), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([view(image=changed)]), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([view(mask=MASK * 0.5)]), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([View(CAMERA, IMAGE)]), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([view(camera=moved)]), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([view(), view()]), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([view()]), None, [OrientationConfig(), 1]),
        inputs_digest(replace(Views.in_memory([view()]), witnesses=2), HEAD, [OrientationConfig(), 1]),
        inputs_digest(Views.in_memory([view()]), HEAD, [OrientationConfig(along=5.0), 1]),
        inputs_digest(Views.in_memory([view()]), HEAD, [OrientationConfig(), 2]),
    ]
    assert len(set(digests)) == len(digests)
    assert inputs_digest(Views.in_memory([view(IMAGE.clone())]), HEAD, [OrientationConfig(), 1]) == digests[0]


def test_results_of_other_inputs_are_removed_and_it_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    work = ViewCache(tmp_path, Views.in_memory([view()]), OrientationConfig())
    work.keep_only("a")
    work.features(0)
    stored = list(tmp_path.glob("features_*.npz"))
    assert len(stored) == 1
    with caplog.at_level(logging.WARNING):
        ViewCache(tmp_path, Views.in_memory([view()]), OrientationConfig()).keep_only("a")
        assert stored[0].is_file()
        assert caplog.text == ""
        ViewCache(tmp_path, Views.in_memory([view()]), OrientationConfig()).keep_only("b")
    assert not stored[0].is_file()
    assert "other photographs or settings" in caplog.text
