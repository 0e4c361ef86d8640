"""The body behind the hair."""

import torch

from neural_strands.geometry.cameras import Camera, pinhole
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
