"""What lies behind and around the hair."""

import torch

from neural_strands.geometry.cameras import Camera, pinhole
from neural_strands.geometry.mesh import Mesh
from neural_strands.model.compositing import REACH, Background, Body, SkinChange, SurroundConfig, near_hair


def test_the_centre_is_the_present_one_with_and_without_inference_mode():
    for inference in (False, True):
        with torch.inference_mode(inference):
            background = Background(torch.tensor([1.0, 2.0, 3.0]), SurroundConfig())
            assert background.centre_on_cpu.tolist() == [1, 2, 3]
            background.centre[0] = 4.0
            assert background.centre_on_cpu.tolist() == [4, 2, 3]


def test_hair_is_near_its_strands_alone():
    coverage = torch.zeros(90, 70)
    coverage[40, 2:5] = 0.3
    coverage[89, 69] = 0.01
    near = near_hair(coverage)
    rows, columns = torch.meshgrid(torch.arange(90), torch.arange(70), indexing="ij")
    places = torch.stack([rows, columns], dim=-1)
    apart = (places[:, :, None] - torch.nonzero(coverage)).abs().amax(dim=-1).amin(dim=-1)
    assert (near[apart <= REACH] == 1).all()
    assert (near[apart > 3 * REACH] == 0).all()
    between = near[(apart > REACH + 1) & (apart < 3 * REACH)]
    assert ((between > 0) & (between < 1)).all()


def wall(corner_uv=None):
    """A triangle that fills all of a small picture."""
    vertices = torch.tensor([[-9.0, -9.0, 1.0], [9.0, -9.0, 1.0], [0.0, 9.0, 1.0]])
    return Body(Mesh(vertices, torch.tensor([[0, 1, 2]]), corner_uv), SurroundConfig(body_texture=4))


@torch.no_grad()
def test_skin_is_lit_anew_where_it_is_known_and_replaced_where_it_is_not():
    body, camera = wall(), Camera(pinhole(8.0, (8, 8)), torch.eye(4), 8, 8)
    body.colour.copy_(torch.tensor([[0.2, 0.3, 0.4]]).expand(3, 3))
    for share in (0.0, 0.25, 1.0):
        change = SkinChange(torch.full((3,), 1.5), torch.full((3, 3), 0.7), torch.full((3,), share))
        expected = (1 - share) * 1.5 * body.colour[0] + share * 0.7
        torch.testing.assert_close(body(camera, change=change).colour, expected.expand(8, 8, 3))


@torch.no_grad()
def test_colours_at_vertices_are_those_of_the_texture_there():
    uv = torch.tensor([[[0.125, 0.125], [0.875, 0.125], [0.125, 0.875]]])
    body = wall(uv)
    body.colour.copy_(torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(0)))
    # Texel centres lie at (k + 0.5) / 4.
    expected = torch.stack([body.colour[0, 0], body.colour[0, 3], body.colour[3, 0]])
    torch.testing.assert_close(body.vertex_colours(), expected)
    assert wall().vertex_colours().shape == (3, 3)
