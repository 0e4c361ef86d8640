"""Masks that contradict each other are noticed, and hair that one of them misses then stays in the hull."""

import shutil

import cv2
import pytest
import torch
from tiny_capture import write_capture

from neural_strands.capture import mask_agreement
from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.mask_agreement import DOUBTFUL, share_without_room, with_judged_masks
from neural_strands.flow.hair_flow import hair_masks
from neural_strands.flow.hull import hairy_points
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.visual_hull import HeadView


@pytest.fixture(autouse=True)
def _small_pictures(monkeypatch):
    """The pictures of the ball end 15 cm from its middle."""
    monkeypatch.setattr(mask_agreement, "REACH", 0.14)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture") / "ball"
    strands = write_capture(folder, views=16)
    return folder, strands


def spoiled(folder, out, view, columns):
    """A copy of a capture in which one view's mask has no hair in some columns."""
    shutil.copytree(folder, out)
    path = out / "masks" / f"{view:03d}.png"
    mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert mask is not None
    assert (mask[:, columns] > 0).any()
    mask[:, columns] = 0
    assert cv2.imwrite(str(path), mask)
    return Capture.load(out)


def test_exact_masks_agree(scene):
    folder, _ = scene
    capture, said = Capture.load(folder), []
    head = find_head(capture).mesh
    assert share_without_room(capture.views_on(), head) < 0.2 * DOUBTFUL
    assert with_judged_masks(capture, range(16), head, said.append) is capture
    assert said == []


def test_without_a_head_or_masks_nothing_is_known(scene, tmp_path):
    folder, _ = scene
    capture = spoiled(folder, tmp_path / "spoiled", 0, slice(0, 32))
    assert with_judged_masks(capture, range(16), None, pytest.fail) is capture
    write_capture(tmp_path / "bare", with_masks=False)
    bare = Capture.load(tmp_path / "bare")
    assert with_judged_masks(bare, range(6), find_head(bare).mesh, pytest.fail) is bare


def test_hair_that_one_mask_misses_is_kept_if_two_views_have_to_agree(scene, tmp_path):
    folder, strands = scene
    capture, said = spoiled(folder, tmp_path / "spoiled", 0, slice(0, 24)), []
    head = find_head(capture).mesh
    assert share_without_room(capture.views_on(), head) > 2 * DOUBTFUL
    judged = with_judged_masks(capture, range(16), head, said.append)
    assert judged.witnesses == 2
    assert judged.subset([0, 1]).views_on().reduced(32).witnesses == 2
    assert len(said) == 1
    points, index = strands[:, 4:].reshape(-1, 3), MeshIndex(head)
    kept = {}
    for name, some in (("exact", Capture.load(folder)), ("spoiled", capture), ("judged", judged)):
        views = some.views_on()
        masks = hair_masks(views, [HeadView.of(camera, index) for camera in views.cameras])
        kept[name] = hairy_points(points, masks, witnesses=views.witnesses)
    assert (kept["exact"] & kept["spoiled"]).sum() < 0.9 * kept["exact"].sum()
    # One wrong mask adds at most one view that shows a place to be empty.
    assert torch.equal(kept["exact"] & kept["judged"], kept["exact"])
