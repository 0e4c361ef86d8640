"""The body behind the hair."""

from dataclasses import replace

import torch

from neural_strands.geometry.cameras import Camera, TorsoMotion, pinhole
from neural_strands.geometry.mesh import Mesh
from neural_strands.model.surround.body import Body, SkinChange, SurroundConfig


def wall():
    """A triangle that fills all of a small picture."""
    vertices = torch.tensor([[-9.0, -9.0, 1.0], [9.0, -9.0, 1.0], [0.0, 9.0, 1.0]])
    return Body(Mesh(vertices, torch.tensor([[0, 1, 2]])), SurroundConfig(body_texture=6))


@torch.no_grad()
def test_skin_is_lit_anew_where_it_is_known_and_replaced_where_it_is_not():
    body, camera = wall(), Camera(pinhole(8.0, (8, 8)), torch.eye(4), 8, 8)
    body.colour.copy_(torch.tensor([0.2, 0.3, 0.4]).expand_as(body.colour))
    for share in (0.0, 0.25, 1.0):
        change = SkinChange(torch.full((3,), 1.5), torch.full((3, 3), 0.7), torch.full((3,), share))
        expected = (1 - share) * 1.5 * body.colour[0, 0] + share * 0.7
        torch.testing.assert_close(body(camera, change=change).colour, expected.expand(8, 8, 3))


@torch.no_grad()
def test_colours_at_vertices_are_those_of_the_texture_there():
    body = wall()
    body.colour.copy_(torch.rand(6, 6, 3, generator=torch.Generator().manual_seed(0)))
    # The first face of a block of six texels has its corners at three steps from each other.
    expected = torch.stack([body.colour[0, 0], body.colour[0, 3], body.colour[3, 0]])
    torch.testing.assert_close(body.vertex_colours(), expected)
    # Two faces that share an edge: the mean where both meet, each alone elsewhere, nothing where there is no face.
    faces = torch.tensor([[0, 1, 2], [2, 1, 3]])
    body = Body(Mesh(torch.rand(5, 3), faces), SurroundConfig(body_texture=6))
    texels = body.atlas.texels()
    body.colour.view(-1, 3)[texels.texel] = texels.face[:, None].float()
    torch.testing.assert_close(body.vertex_colours()[:, 0], torch.tensor([0.0, 0.5, 0.5, 1.0, 0.0]))


@torch.no_grad()
def test_its_torso_is_drawn_where_the_photograph_shows_it():
    """Two patches above and below a neck: only the lower one is shifted, by a pixel, and keeps its colours."""
    corners = torch.tensor([[-0.5, -0.5, 1.0], [0.5, -0.5, 1.0], [0.5, -0.25, 1.0], [-0.5, -0.25, 1.0]])
    vertices = torch.cat([corners, corners + torch.tensor([0.0, 0.75, 0.0])])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    body = Body(Mesh(vertices, faces), SurroundConfig(body_texture=6))
    texels = body.atlas.texels()
    body.colour.view(-1, 3)[texels.texel] = 0.2 * (1 + texels.face[:, None].float()).expand(-1, 3)
    shift = torch.eye(4)
    shift[0, 3] = 1 / 16
    camera = Camera(pinhole(16.0, (16, 16)), torch.eye(4), 16, 16)
    torso = TorsoMotion(shift, torch.tensor([[0.0, -0.1, 1.0], [0.0, 0.1, 1.0]]))
    still, moved = body(camera).colour, body(replace(camera, torso=torso)).colour
    assert torch.equal(moved[:8], still[:8])
    assert torch.equal(moved[8:, 1:], still[8:, :-1])
    assert still[:8].amax() > 0.2
    assert still[8:].amax() > 0.6
