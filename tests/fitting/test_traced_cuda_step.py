"""The losses of both kinds of step, traced on a fake CUDA device: devices, shapes, synchronisations."""

import torch
from tiny_capture import tiny_config
from tiny_hair import tiny_hair_model
from traced_cuda import on_traced_cuda, traced_cuda

from neural_strands.fitting.fit_data import FitData
from neural_strands.fitting.geometry_step import StepStrands, shape_losses
from neural_strands.fitting.losses import OrientedTargets, alpha_loss, rendering_loss
from neural_strands.fitting.photographs.streak_loss import Streaks, streak_loss
from neural_strands.fitting.photographs.trimap import reference_alpha
from neural_strands.fitting.seen_points import front_segments, seen_points
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.views import View, Views
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.scalp.head import Head

WIDTH, HEIGHT = 64, 48
STEP_POINTS, SOME, TARGETS = 12, 80, 300


def fit_data(points: int, radius: float) -> FitData:
    """Segment points on the device and the distance to a head, without views."""
    position, along = torch.rand(2, points, 3, device="cuda")
    ones = torch.ones(points, device="cuda")
    nodes = SignedDistanceGrid(VoxelGrid((-0.2, -0.2, -0.2), 0.1, (5, 5, 5)), torch.rand(5, 5, 5, device="cuda"))
    mesh = Mesh(torch.rand(3, 3, device="cuda"), torch.tensor([[0, 1, 2]], device="cuda"))
    return FitData(
        Views((), (), lambda *_: None),
        Head(mesh, torch.tensor([0], device="cuda"), torch.rand(1, 3, 2, device="cuda")),
        LineSegments(position, along, ones, ones.long()),
        OrientedTargets(position, along, PointGrid.build(position, radius)),
        nodes,
    )


def front_view() -> Camera:
    return Camera.look_at(torch.tensor([0.0, 0.1, 0.6]), torch.zeros(3), 100.0, (WIDTH, HEIGHT))


def test_the_losses_of_an_image_step_stay_on_the_device():
    model, config = tiny_hair_model(), tiny_config()
    with traced_cuda() as (mode, waits):
        on_traced_cuda(model, mode)
        camera = front_view()
        mask = torch.rand(HEIGHT, WIDTH, device="cuda")
        view = View(camera, torch.rand(HEIGHT, WIDTH, 3, device="cuda"), mask)
        strands = model.decode()
        waits.clear()
        trimap = reference_alpha(mask, Rectangle(0, 0, WIDTH, HEIGHT), config.trimap)
        output = model.render(strands, camera, body_weight=mask)
        for loss in (rendering_loss(output.rgb, view.image), alpha_loss(output.alpha, trimap.alpha, trimap.supervised)):
            assert loss.device.type == "cuda"
            assert loss.shape == ()
        # The box of the hair (six numbers of one answer), and the visible parts and their nodes (two of another).
        assert dict(waits) == {"aten._local_scalar_dense.default": 8}


def test_the_losses_of_a_shape_step_stay_on_the_device():
    model, config, random = tiny_hair_model(), tiny_config(), torch.Generator().manual_seed(0)
    with traced_cuda() as (mode, waits):
        on_traced_cuda(model, mode)
        data = fit_data(1000, config.chamfer.surface_radius)
        remembered = model.decode(STEP_POINTS).points
        camera = front_view().to(remembered.device)
        pixels = torch.arange(WIDTH * HEIGHT, dtype=torch.int32, device="cuda")
        body = torch.rand(len(pixels), device="cuda")
        streaks = Streaks(camera, pixels, torch.rand(len(pixels), 2, device="cuda").half(), body)
        waits.clear()
        seen = seen_points(model, remembered, [camera])
        assert not waits
        chosen = StepStrands.drawn(len(remembered), SOME, random, remembered.device)
        strands = model.decode(STEP_POINTS, index=chosen.index).points
        assert not waits
        targets = torch.arange(TARGETS, device="cuda")
        losses = shape_losses(strands, chosen, remembered, remembered, seen, data, targets, config)
        # The grid of all points has corners: six numbers of one answer.
        assert dict(waits) == {"aten._local_scalar_dense.default": 6}
        waits.clear()
        segments = front_segments(model, remembered, camera, streaks.body_depth())
        row = torch.full((len(remembered),), -1, device="cuda")
        turned = streak_loss(strands, row, [streaks], [segments], 200, random)
        assert not waits
        for loss in (losses.surface, losses.coverage, losses.head, losses.first, losses.hidden, turned):
            assert loss.device.type == "cuda"
            assert loss.shape == ()
