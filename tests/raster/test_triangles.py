import dataclasses

import pytest
import torch
import warp as wp

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import interpolate
from neural_strands.raster.kernels.triangles import draw_triangles, draw_triangles_in_lanes
from neural_strands.raster.keys import empty_keys
from neural_strands.raster.lines import projection_matrix
from neural_strands.raster.reference import rasterise_triangles_reference
from neural_strands.raster.triangles import rasterise_triangles


def soup(generator, count=200):
    vertices = (torch.rand(count, 1, 3, generator=generator) - 0.5) + torch.randn(
        count, 3, 3, generator=generator
    ) * 0.1
    return vertices.view(-1, 3), torch.arange(3 * count).view(-1, 3)


def double(camera):
    return dataclasses.replace(
        camera, intrinsics=camera.intrinsics.double(), world_to_camera=camera.world_to_camera.double()
    )


@pytest.mark.parametrize("distance", [1.5, 0.4, 0.0])
def test_agrees_with_ray_casting(generator, device, distance):
    """Seen from outside, and from inside triangles that reach behind the camera."""
    camera = Camera.look_at(torch.tensor([0.1, 0.2, distance]), torch.tensor([0.0, 0.0, -1.0]), 60.0, (53, 41))
    vertices, faces = soup(generator)
    found = rasterise_triangles(vertices.to(device), faces.to(device), camera.to(device))
    face, barycentric, depth = rasterise_triangles_reference(vertices.double(), faces, double(camera))
    same = found.face.cpu() == face
    assert (face >= 0).float().mean() > 0.3
    assert (~same).float().mean() < 0.002
    hit = same & (face >= 0)
    torch.testing.assert_close(found.depth.cpu()[same], depth[same], rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(found.barycentric.cpu()[hit], barycentric[hit], rtol=1e-3, atol=1e-3)
    assert (found.barycentric.cpu()[found.face.cpu() < 0] == 0).all()


@pytest.mark.parametrize("distance", [1.5, 0.4, 0.0])
@pytest.mark.parametrize("spread", [0.02, 0.5])
def test_the_kernel_of_the_cpu_draws_what_that_of_cuda_draws(generator, distance, spread):
    """The same keys, bit for bit, for faces of a few pixels and of many; some are not finite or have no area."""
    camera = Camera.look_at(torch.tensor([0.1, 0.2, distance]), torch.tensor([0.0, 0.0, -1.0]), 150.0, (131, 97))
    vertices, faces = soup(generator)
    vertices = vertices.view(-1, 3, 3)
    vertices = vertices.mean(dim=1, keepdim=True) + spread * 10 * (vertices - vertices.mean(dim=1, keepdim=True))
    vertices[0, 1, 2], vertices[1, 2] = torch.inf, vertices[1, 1]
    cpu = torch.device("cpu")
    keys = [empty_keys(camera.height, camera.width, cpu) for _ in range(2)]
    matrix = projection_matrix(camera, cpu)
    shared = [
        kernels.array(vertices.view(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], wp.vec3),
        kernels.array(faces.int(), wp.vec3i),
        0.01,
        camera.width,
        0,
        camera.height,
    ]
    kernels.launch(draw_triangles, len(faces), [*shared, 1, kernels.array(keys[0].view(-1))], cpu)
    kernels.launch(draw_triangles_in_lanes, len(faces), [*shared, kernels.array(keys[1].view(-1))], cpu)
    assert torch.equal(keys[0], keys[1])
    assert len(keys[0].unique()) > 50


def test_interpolated_positions_lie_on_their_rays(generator):
    camera = Camera.look_at(torch.tensor([0.1, 0.2, 1.5]), torch.zeros(3), 200.0, (97, 75))
    vertices, faces = soup(generator)
    buffer = rasterise_triangles(vertices, faces, camera)
    hit = buffer.face >= 0
    points = interpolate(vertices[faces], buffer.face[hit], buffer.barycentric[hit])
    pixels, depth = camera.project(points)
    torch.testing.assert_close(pixels, camera.pixel_centres()[hit], rtol=0, atol=1e-3)
    torch.testing.assert_close(depth, buffer.depth[hit], rtol=1e-5, atol=1e-6)


def test_a_closed_surface_has_no_cracks(generator):
    """A height field of jittered triangles that fills the view leaves no pixel out, wherever the edges fall."""
    side = 33
    x, y = torch.meshgrid(*(torch.linspace(-1, 1, side),) * 2, indexing="xy")
    z = torch.rand(side, side, generator=generator) * 0.02
    vertices = torch.stack([x, y, z], dim=-1).view(-1, 3)
    cell = (torch.arange(side - 1)[:, None] * side + torch.arange(side - 1)).view(-1)
    faces = torch.cat(
        [torch.stack(c, 1) for c in ((cell, cell + 1, cell + side), (cell + 1, cell + side + 1, cell + side))]
    )
    for size in (64, 65, 128):
        camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 0.6 * size, (size, size))
        assert (rasterise_triangles(vertices, faces, camera).face >= 0).all()


def test_an_enclosing_sphere_fills_the_view():
    directions = torch.tensor([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = torch.tensor([[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)])
    camera = Camera.look_at(torch.tensor([0.1, 0.05, 0.0]), torch.tensor([0.3, 0.2, 1.0]), 20.0, (31, 33))
    buffer = rasterise_triangles(directions * 5, faces, camera)
    assert (buffer.face >= 0).all()


def test_nothing_to_see():
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 20.0, (8, 6))
    empty = rasterise_triangles(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int64), camera)
    vertices = torch.tensor([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, torch.nan]])
    broken = rasterise_triangles(vertices, torch.tensor([[0, 1, 2], [0, 0, 1]]), camera)
    for buffer in (empty, broken):
        assert (buffer.face == -1).all()
        assert buffer.depth.isinf().all()
