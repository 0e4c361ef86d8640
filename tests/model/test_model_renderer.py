"""The renderer against the model that it holds: own strands, edited ones, no gradient."""

from dataclasses import replace

import pytest
import torch
from test_model_hair_model import model, stubble, view

from neural_strands.model.renderer import HairRenderer


def test_it_shows_what_the_model_shows():
    hair = model(mixed_precision=False)
    renderer = HairRenderer.of(hair)
    assert torch.equal(renderer.strands.points, hair.decode().points)
    for camera in (view(), view((37, 29), (0.3, 0.4, 0.2))):
        found, expected = renderer.render(camera), hair(camera)
        assert torch.equal(found.rgb, expected.rgb)
        assert torch.equal(found.alpha, expected.alpha)
        assert not found.rgb.requires_grad


def test_edited_strands_take_the_place_of_its_own():
    hair = model(mixed_precision=False)
    first = HairRenderer.of(hair)
    edited = first.showing(stubble(hair))
    assert edited.light is not None
    assert torch.equal(
        edited.render(view()).rgb, hair.render(stubble(hair), view(), volume=edited.volume, light=edited.light).rgb
    )
    assert not torch.equal(edited.render(view()).rgb, first.render(view()).rgb)
    assert torch.equal(first.render(view()).rgb, hair(view()).rgb)


def test_the_volume_is_that_of_the_strands_shown():
    """When half the hair is shaved off, the rest is lit as hair that stands alone, not as it was before."""
    hair = model(mixed_precision=False)
    renderer = HairRenderer.of(hair)
    shaved = renderer.showing(renderer.strands.select(torch.arange(0, len(renderer.strands), 2)))
    assert shaved.light is not None
    assert float(shaved.light.strands.min()) > 0.999
    assert torch.equal(
        shaved.render(view()).rgb, hair.render(shaved.strands, view(), volume=shaved.volume, light=shaved.light).rgb
    )
    unlit = renderer.model.render(shaved.strands, view()).behind_rgb.detach()
    assert float((shaved.render(view()).behind_rgb - unlit).min()) > -0.001


def test_hair_that_was_not_edited_is_shown_as_it_was_fitted():
    renderer = HairRenderer.of(model())
    assert renderer.showing(renderer.strands) is renderer
    edited = renderer.showing(renderer.strands.select(torch.arange(5)))
    assert edited.showing(renderer.strands) is renderer
    assert edited.fitted is renderer


def test_strands_without_a_place_on_the_scalp_are_refused_at_once():
    hair = model()
    with pytest.raises(ValueError, match="root_uv"):
        HairRenderer.of(hair, replace(stubble(hair), root_uv=None))


def test_some_roots_decode_to_the_same_strands_as_all():
    hair, index = model(), torch.tensor([5, 0, 17])
    every, some = hair.decode(20), hair.decode(20, index=index)
    torch.testing.assert_close(some.points, every.points[index], rtol=0, atol=1e-6)
    assert some.root_uv is not None
    assert torch.equal(some.root_uv, hair.root_uv[index])


def test_what_is_prepared_for_edits_changes_none():
    hair = model()
    first, later = HairRenderer.of(hair), HairRenderer.of(hair)
    first.prepare_edits()
    pictures = [renderer.showing(stubble(hair)).render(view()).rgb for renderer in (first, later)]
    assert torch.equal(*pictures)


def test_more_strands_that_stand_for_fewer_each_are_lit_as_before():
    hair = model()
    renderer = HairRenderer.of(hair)
    twice = renderer.strands.select(torch.arange(len(renderer.strands)).repeat_interleave(2))
    finer, denser = renderer.showing(twice, 0.5), renderer.showing(twice)
    torch.testing.assert_close(finer.volume.values, renderer.volume.values, atol=1e-4, rtol=1e-4)
    assert finer.light is not None
    torch.testing.assert_close(finer.light.strands, torch.ones_like(finer.light.strands), atol=1e-4, rtol=0)
    assert denser.light is not None
    assert float(denser.light.strands.mean()) < 0.995
    # Moving hair keeps the number.
    assert finer.showing(replace(twice, points=twice.points + 0.001)).each == 0.5
