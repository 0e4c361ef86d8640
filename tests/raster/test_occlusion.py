import pytest
import torch
import warp as wp

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.raster import occlusion
from neural_strands.raster.kernels.lines import draw_lines
from neural_strands.raster.kernels.occlusion import list_unhidden
from neural_strands.raster.keys import background_keys, key_index
from neural_strands.raster.lines import projection_matrix

CPU = torch.device("cpu")
WIDTH, HEIGHT = 203, 150


def dense_hair(generator, strands=1500, points=70):
    """A thick mat of strands, more than one batch long, with gaps at its left and right."""
    start = torch.rand(strands, 1, 3, generator=generator) * torch.tensor([0.7, 0.1, 0.5]) + torch.tensor(
        [-0.3, 0.25, -0.25]
    )
    steps = torch.randn(strands, points - 1, 3, generator=generator) * 0.002 - torch.tensor([0.0, 0.008, 0.0])
    return torch.cat([start, start + steps.cumsum(1)], dim=1)


def drawn(points, camera, width, tip=0.0, occluder=None, t=None):
    """Keys of all pixels: by the kernel that draws every segment, and without hidden ones."""
    count, per_strand = points.shape[:2]
    depth = torch.full((HEIGHT, WIDTH), torch.inf) if occluder is None else occluder
    keys = [background_keys(depth).flatten() for _ in range(2)]
    vertices = kernels.array(points.reshape(-1, 3), wp.vec3)
    projection = kernels.array(projection_matrix(camera, CPU)[None], wp.mat44)
    parameters = kernels.array(torch.zeros(0) if t is None else t.flatten())
    taper, size = [width, tip, parameters], [WIDTH, HEIGHT]
    inputs = [0, vertices, projection, 0.01, *taper, per_strand, 1, per_strand - 1, *size, kernels.array(keys[0])]
    kernels.launch(draw_lines, count, inputs, CPU)
    for first, last in ((0, count // 3), (count // 3, count)):
        shared = [vertices, projection, 0.01, per_strand]
        occlusion.draw_unhidden(first, last - first, shared, taper, size, kernels.array(keys[1]))
    return keys


def camera_at(distance):
    return Camera.look_at(torch.tensor([0.05, 0.02, distance]), torch.tensor([0.0, 0.0, -0.5]), 150.0, (WIDTH, HEIGHT))


@pytest.mark.parametrize("distance", [1.2, 0.5, 0.2, 0.0])
@pytest.mark.parametrize(("width", "tip"), [(0.001, 0.0), (0.004, 0.4), (0.03, 1.0)])
def test_the_keys_are_those_of_drawing_every_segment(generator, distance, width, tip):
    """From a sixth of a pixel to many pixels wide, in front of the camera and through it, across the borders."""
    points = dense_hair(generator)
    points[3, 40, 1] = torch.nan
    points[4, 20] = torch.inf
    expected, found = drawn(points, camera_at(distance), width, tip)
    assert (key_index(expected) >= 0).sum() > 500
    assert torch.equal(found, expected)


def test_the_keys_are_the_same_behind_an_occluder(generator):
    occluder = 0.8 + 0.3 * torch.rand(HEIGHT, WIDTH, generator=generator)
    occluder[:, 60:90] = torch.inf
    points, camera = dense_hair(generator), camera_at(1.2)
    t = torch.rand(points.shape[:2], generator=generator).sort(dim=1).values
    expected, found = drawn(points, camera, 0.004, 0.5, occluder, t)
    open_air, _ = drawn(points, camera, 0.004, 0.5, None, t)
    assert torch.equal(found, expected)
    assert (key_index(expected) != key_index(open_air)).float().mean() > 0.1


def test_fewer_strands_than_rounds(generator):
    for count in (1, 2, 3):
        expected, found = drawn(dense_hair(generator, count), camera_at(1.2), 0.01)
        assert (key_index(expected) >= 0).any()
        assert torch.equal(found, expected)


@pytest.mark.parametrize(("depth", "left"), [(1.6, 0), (1.4, 99)])
def test_only_segments_behind_the_veils_are_left_out(depth, left):
    """A strand across the picture, behind or in front of what covers all of it 1.5 m away."""
    pixels = torch.stack([torch.linspace(20, 180, 100), torch.linspace(30, 120, 100)], dim=1)
    assert listed(pixels, depth, 1.5) == left


def test_segments_beside_the_picture_are_left_out():
    """Half of the strand lies to the left of the picture."""
    pixels = torch.stack([torch.linspace(-99, 99, 100), torch.full((100,), 60.0)], dim=1)
    assert listed(pixels, 1.4, torch.inf) == pytest.approx(50, abs=2)


def listed(pixels, depth, covered):
    """Number of a strand's segments that remain to be drawn where everything at a depth is covered."""
    camera = camera_at(1.0)
    points = camera.unproject(pixels, torch.full((len(pixels),), depth))
    across, down = -(-WIDTH // occlusion.BLOCK), -(-HEIGHT // occlusion.BLOCK)
    levels = torch.full((2 * across * down,), 1 / covered)
    found, count = (torch.zeros(size, dtype=torch.int32) for size in (len(pixels) - 1, 1))
    inputs = [0, 1, kernels.array(points, wp.vec3), kernels.array(projection_matrix(camera, CPU)[None], wp.mat44)]
    inputs += [0.01, 0.001, len(pixels), WIDTH, HEIGHT, across, down, kernels.array(levels)]
    kernels.launch(list_unhidden, 1, [*inputs, kernels.array(found), kernels.array(count)], CPU)
    return int(count)
