"""A frame traced on a fake CUDA device: devices, shapes, and number of synchronisations."""

import pytest
import torch
from tiny_hair import tiny_hair_model
from traced_cuda import on_traced_cuda, traced_cuda

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.kernels.point_queries import nearest_kernel
from neural_strands.geometry.kernels.voxel_grid import sample_kernel
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import nearest_reference
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.model.hair_volume import hair_volume
from neural_strands.model.renderer import HairRenderer

WIDTH, HEIGHT = 64, 48


def view() -> Camera:
    return Camera.look_at(torch.tensor([0.0, 0.1, 0.6]), torch.zeros(3), 100.0, (WIDTH, HEIGHT))


def test_a_whole_frame_is_traced_on_the_device():
    model = tiny_hair_model()
    with traced_cuda() as (mode, waits):
        on_traced_cuda(model, mode)
        strands = model.decode()
        assert strands.points.device.type == "cuda"
        assert strands.points.shape == (200, 20, 3)
        assert not waits
        # The box of the hair is the size of a grid.
        volume = hair_volume(strands.points)
        assert sum(waits.values()) == 6
        assert set(waits) == {"aten._local_scalar_dense.default"}
        assert volume.values.device.type == "cuda"
        renderer = HairRenderer(model, strands, volume)
        renderer.render(view())
        waits.clear()
        output = renderer.render(view())
        # The number of visible parts of strands determines the size of what follows; the host waits for nothing else.
        assert dict(waits) == {"aten._local_scalar_dense.default": 1}
        for picture, channels in ((output.rgb, (3,)), (output.alpha, ()), (output.hair_rgb, (3,))):
            assert picture.device.type == "cuda"
            assert picture.shape == (HEIGHT, WIDTH, *channels)


def test_arrays_of_two_devices_are_refused_in_a_trace():
    grid = VoxelGrid((0.0, 0.0, 0.0), 1.0, (2, 2, 2))
    with traced_cuda(), pytest.raises(RuntimeError, match="expected all arrays on one device, found"):
        grid.sample(torch.zeros(2, 2, 2, 1), torch.zeros(5, 3, device="cuda"), outside="border")


def test_the_operator_computes_what_a_launch_computes(generator):
    grid, values = VoxelGrid((0.1, 0.2, 0.3), 0.5, (3, 4, 5)), torch.rand(3, 4, 5, 2, generator=generator)
    points, sampled = torch.rand(50, 3, generator=generator), torch.zeros(50, 2)
    kernel: kernels.Kernel = sample_kernel
    name = f"{kernel.module.name}.{kernel.key}"
    numbers = [0, *grid.origin, grid.spacing, *grid.shape, 0]
    kernels.launch_operator(name, 50, [values.view(-1, 2), points, sampled], numbers, True)
    assert torch.equal(sampled, grid.sample(values, points, outside="border"))


def test_the_operator_puts_structs_together_again(generator):
    points, queries = torch.rand(2, 80, 3, generator=generator)
    grid, radius = PointGrid.build(points, 0.3), 0.2
    distance, index = torch.full((80,), torch.inf), torch.full((80,), -1, dtype=torch.int32)
    kernel: kernels.Kernel = nearest_kernel
    cells = [*grid.lower, *grid.cells, grid.cell, grid.mask]
    arrays = [grid.points, grid.starts, grid.order, queries, distance, index]
    kernels.launch_operator(f"{kernel.module.name}.{kernel.key}", 80, arrays, [0, *cells, radius], True)
    expected = nearest_reference(queries, points, radius)
    torch.testing.assert_close(distance, expected[0])
    assert torch.equal(index.long(), expected[1])
