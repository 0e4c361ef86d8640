"""Person masks determine where body and background learn from: by hand, in closed form, and over a tiny fit."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.photographs.surround_weights import surround_weights
from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View
from neural_strands.prior.vae import load_prior
from neural_strands.raster.triangles import rasterise_triangles

CPU = torch.device("cpu")
CHIN = -0.03
"""Height below which the tiny capture's ball, as photographed, is not there: its mesh is longer than the person."""


@pytest.fixture
def view() -> View:
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 60.0, (4, 1))
    hair, person = torch.tensor([[0.0, 0.3, 1.0, 0.0]]), torch.tensor([[1.0, 0.9, 1.0, 0.05]])
    return View(camera, torch.zeros(1, 4, 3), hair, person)


def test_the_body_learns_from_hair_and_person_and_the_background_from_the_rest(view):
    found = surround_weights(view)
    assert found is not None
    torch.testing.assert_close(found.body, torch.tensor([[1.0, 0.9, 1.0, 0.05]]))
    torch.testing.assert_close(found.background, torch.tensor([[0.0, 0.0, 0.0, 0.95]]))


def test_hair_counts_where_the_mask_of_the_person_leaves_it_out(view):
    found = surround_weights(replace(view, person_mask=torch.zeros(1, 4)))
    assert found is not None
    assert torch.equal(found.body, view.hair_mask)
    torch.testing.assert_close(found.background, torch.tensor([[1.0, 0.0, 0.0, 1.0]]))


def test_without_a_hair_mask_what_is_drawn_counts_as_hair(view):
    drawn = view.hair_mask
    bare = replace(view, hair_mask=None)
    for found, expected in (
        (surround_weights(bare, drawn), surround_weights(view)),
        (surround_weights(bare), surround_weights(view, torch.zeros(1, 4))),
    ):
        assert found is not None
        assert expected is not None
        assert torch.equal(found.body, expected.body)
        assert torch.equal(found.background, expected.background)


def test_where_the_person_is_not_known_nothing_is_said(view):
    assert surround_weights(replace(view, person_mask=None)) is None


def shorten_the_person(folder, with_person_masks):
    """Photographs whose ball ends at CHIN, the background's grey below, and the masks of that person."""
    capture = Capture.load(folder)
    head = find_head(capture).mesh
    middle = head.vertices[head.faces].mean(dim=1)[:, 1]
    (folder / "person_masks").mkdir()
    for k, camera in enumerate(capture.cameras):
        hair = capture.hair_mask(k)
        assert hair is not None
        face = rasterise_triangles(head.vertices, head.faces, camera).face
        shown = (face >= 0) & (middle[face.clamp(min=0)] > CHIN)
        path = folder / "images" / camera.name
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
        assert image is not None
        image[((face >= 0) & ~shown & (hair == 0)).numpy()] = 153
        assert cv2.imwrite(str(path), image)
        person = (shown | (hair > 0)).byte().mul(255).numpy().astype(np.uint8)
        if with_person_masks:
            assert cv2.imwrite(str(folder / "person_masks" / camera.name), person)
    return head.vertices[:, 1]


@pytest.mark.parametrize("with_person_masks", [True, False])
def test_a_body_drawn_beside_the_person_learns_nothing_there(tmp_path, with_person_masks):
    """Vertices well below the chin are seen by no pixel of the person: they keep the mean of the skin.

    Without masks of the person they take the grey of the background that was photographed there.
    """
    strands = write_capture(tmp_path / "ball")
    height = shorten_the_person(tmp_path / "ball", with_person_masks)
    capture, config = Capture.load(tmp_path / "ball"), tiny_config(shape_every=0)
    data = gather_fit_data(capture, find_head(capture), true_segments(strands), config, CPU)
    state = begin(data, load_prior(), config)
    fit(state, data, config)
    below = state.model.body.vertex_colours().detach()[(height < CHIN - 0.03) & (height > -0.07)]
    skin, grey = to_linear(torch.tensor([0.8, 0.6, 0.5])), to_linear(torch.full((3,), 0.6))
    assert len(below) > 20
    to_skin, to_grey = ((below - colour).abs().mean() for colour in (skin, grey))
    if with_person_masks:
        torch.testing.assert_close(below, below[:1].expand_as(below))
        assert to_skin < 0.05
    else:
        assert to_grey < 0.05
    background = state.model.background.colour.detach()
    assert (background.mean(dim=(1, 2)) - grey).abs().max() < 0.02
