import dataclasses

import pytest
import torch
import warp as wp

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.raster.kernels.line_batches import draw_strands
from neural_strands.raster.kernels.lines import draw_lines
from neural_strands.raster.keys import empty_keys, key_index
from neural_strands.raster.lines import LineConfig, projection_matrix, rasterise_lines
from neural_strands.raster.reference import rasterise_lines_reference
from neural_strands.raster.visible import visible_points

SIZE = (40, 32)


@pytest.fixture
def camera():
    """Looks along -z from one metre in front of the origin, where a metre is 100 pixels."""
    return Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 100.0, SIZE)


def at_pixels(camera, pixels, depth):
    return camera.unproject(torch.tensor(pixels), torch.tensor(depth))[None]


def wavy(generator, count=300, points=12):
    start = torch.randn(count, 1, 3, generator=generator) * 0.1
    return start + (torch.randn(count, points, 3, generator=generator) * 0.03).cumsum(1)


def same_buffers(found, expected):
    """Equal except for the few pixels where rounding decides between two segments or two pixels."""
    same = found.segment == expected.segment
    assert (~same).float().mean() < 0.005
    torch.testing.assert_close(found.depth[same], expected.depth[same], rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(found.position[same], expected.position[same], rtol=1e-3, atol=2e-3)


@pytest.mark.parametrize("distance", [1.0, 0.3, 0.0])
def test_agrees_with_the_twin(generator, device, distance):
    """In front of the hair, at its edge and inside it, with strands behind the camera and lines across the screen."""
    camera = Camera.look_at(torch.tensor([0.05, 0.02, distance]), torch.tensor([0.0, 0.0, -0.5]), 150.0, (160, 120))
    points = wavy(generator).to(device)
    occluder = (torch.rand(120, 160, generator=generator) + 0.2).to(device)
    for hidden_by in (None, occluder):
        found = rasterise_lines(points, camera.to(device), hidden_by)
        expected = rasterise_lines_reference(points, camera.to(device), hidden_by)
        assert (expected.segment >= 0).sum() > 500
        same_buffers(found, expected)


@pytest.mark.parametrize(("width", "tip"), [(0.002, 0.0), (0.012, 0.4), (0.04, 1.0)])
def test_wide_strands_agree_with_the_twin(generator, device, width, tip):
    """From a third of a pixel to six pixels, in front of the near plane and through it."""
    camera = Camera.look_at(torch.tensor([0.05, 0.02, 0.8]), torch.zeros(3), 150.0, (160, 120))
    points, config = wavy(generator, 60).to(device), LineConfig(width=width, tip=tip)
    found = rasterise_lines(points, camera.to(device), config=config)
    expected = rasterise_lines_reference(points, camera.to(device), config=config)
    assert (expected.segment >= 0).sum() > 300
    same_buffers(found, expected)


@pytest.mark.parametrize(("width", "tip"), [(0.012, 0.4), (0.04, 1.0)])
def test_strands_thin_by_their_stored_t_as_the_twin_says(generator, device, width, tip):
    camera = Camera.look_at(torch.tensor([0.05, 0.02, 0.8]), torch.zeros(3), 150.0, (160, 120)).to(device)
    points, config = wavy(generator, 60).to(device), LineConfig(width=width, tip=tip)
    t = torch.rand(60, 12, generator=generator).sort(dim=1).values.to(device)
    found = rasterise_lines(points, camera, config=config, t=t)
    same_buffers(found, rasterise_lines_reference(points, camera, config=config, t=t))
    even = torch.linspace(0, 1, 12).expand(60, 12).to(device)
    evenly = rasterise_lines(points, camera, config=config)
    same_buffers(rasterise_lines(points, camera, config=config, t=even), evenly)
    assert (found.segment != evenly.segment).float().mean() > 0.02


def test_a_cut_strand_is_not_thinned_at_its_cut(camera):
    """The half nearer the root, cut from a strand that thins over its farther half, is as wide as its root all along;
    where t = 1 nothing is left of it."""
    config = LineConfig(width=0.06, tip=0.5)
    strand = at_pixels(camera, [[10.0, 4.0 + 2 * k] for k in range(9)], [1.0] * 9)
    cut = torch.linspace(0, 0.5, 9)[None]
    rows = (rasterise_lines(strand, camera, config=config, t=cut).segment >= 0).sum(dim=1)
    assert rows[4:20].tolist() == [6] * 16
    assert (rasterise_lines(strand, camera, config=config, t=torch.ones(1, 9)).segment < 0).all()


@pytest.mark.parametrize("width", [0.3, 1.0, 2.6])
@pytest.mark.parametrize("slope", [0.0, 0.7, -1.9])
def test_a_strand_covers_its_area(camera, width, slope):
    """Length times width, in pixels, averaged over its positions; half of that for a strand that is all tip."""
    config = LineConfig(width=width / 100)
    ends = torch.tensor([[8.0, 16.0], [28.0, 16.0]]) if abs(slope) < 1 else torch.tensor([[20.0, 6.0], [20.0, 26.0]])
    if abs(slope) < 1:
        ends[:, 1] += torch.tensor([-10.0, 10.0]) * slope
    else:
        ends[:, 0] += torch.tensor([-10.0, 10.0]) / slope
    covered, thinned = [], []
    for k in range(200):
        at = ends + (k + 0.5) / 200
        strand = at_pixels(camera, torch.lerp(at[0], at[1], torch.linspace(0, 1, 9)[:, None]).tolist(), [1.0] * 9)
        covered.append((rasterise_lines(strand, camera, config=config).segment >= 0).sum())
        tipped = dataclasses.replace(config, tip=1.0)
        thinned.append((rasterise_lines(strand, camera, config=tipped).segment >= 0).sum())
    area = float((ends[1] - ends[0]).norm()) * width
    assert float(torch.stack(covered).float().mean()) == pytest.approx(area, rel=0.04)
    assert float(torch.stack(thinned).float().mean()) == pytest.approx(area / 2, rel=0.06)


def test_double_precision_twin_agrees(generator):
    camera = Camera.look_at(torch.tensor([0.05, 0.02, 0.8]), torch.zeros(3), 300.0, (200, 150))
    points = wavy(generator, 100)
    exact = dataclasses.replace(
        camera, intrinsics=camera.intrinsics.double(), world_to_camera=camera.world_to_camera.double()
    )
    same_buffers(rasterise_lines(points, camera), rasterise_lines_reference(points.double(), exact))


def test_one_segment_in_closed_form(camera):
    """From (5.2, 10.6) at depth 1 to (25.2, 10.6) at depth 2: at fraction s of the screen the depth is 2 / (2 - s),
    and the position along the segment is s z_0 / (z_1 - s (z_1 - z_0)) = s / (2 - s)."""
    buffer = rasterise_lines(at_pixels(camera, [[5.2, 10.6], [25.2, 10.6]], [1.0, 2.0]), camera)
    rows, columns = torch.nonzero(buffer.segment == 0).unbind(1)
    assert rows.unique().tolist() == [10]
    assert columns.tolist() == list(range(5, 25))
    s = (columns + 0.5 - 5.2) / 20
    torch.testing.assert_close(buffer.depth[rows, columns], 2 / (2 - s), rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(buffer.position[rows, columns], s / (2 - s), rtol=1e-4, atol=1e-4)
    assert (buffer.segment == -1).sum() == 40 * 32 - 20


def test_visible_points_lie_in_their_pixels(generator):
    camera = Camera.look_at(torch.tensor([0.05, 0.02, 0.8]), torch.zeros(3), 300.0, (200, 150))
    points = wavy(generator)
    buffer = rasterise_lines(points, camera)
    visible = visible_points(buffer, points)
    pixels, depth = camera.project(visible.world)
    offset = pixels - camera.pixel_centres().view(-1, 2)[visible.pixel]
    assert offset.abs().max() < 0.501
    assert offset.abs().amin(dim=-1).max() < 1e-3
    torch.testing.assert_close(depth, buffer.depth.view(-1)[visible.pixel], rtol=1e-5, atol=1e-5)


def test_cutting_a_line_into_segments_changes_no_pixel(camera):
    ends = at_pixels(camera, [[3.1, 2.2], [36.7, 29.3]], [1.0, 1.3])
    fractions = torch.linspace(0, 1, 57)[None, :, None]
    chain = torch.lerp(ends[:, :1], ends[:, 1:], fractions)
    one, many = rasterise_lines(ends, camera), rasterise_lines(chain, camera)
    assert torch.equal(one.segment >= 0, many.segment >= 0)
    torch.testing.assert_close(one.depth, many.depth, rtol=1e-5, atol=1e-5)
    assert torch.equal(rasterise_lines(chain.flip(1), camera).segment >= 0, one.segment >= 0)


def test_the_nearer_strand_wins_whatever_the_order(camera):
    near, far = (at_pixels(camera, [[5.0, 10.5], [30.0, 10.5]], [d, d]) for d in (1.0, 1.1))
    for strands, winner in ((torch.cat([near, far]), 0), (torch.cat([far, near]), 1)):
        buffer = rasterise_lines(strands, camera)
        assert buffer.segment[buffer.segment >= 0].unique().tolist() == [winner]


def test_occluder_hides_what_lies_deeper_than_its_bias(camera):
    strands = torch.cat(
        [at_pixels(camera, [[5.0, y], [30.0, y]], [d, d]) for y, d in ((5.5, 0.9), (9.5, 1.001), (20.5, 1.1))]
    )
    occluder = torch.ones(32, 40)
    occluder[:, 20:] = torch.inf
    buffer = rasterise_lines(strands, camera, occluder, LineConfig(occluder_bias=0.002))
    assert buffer.segment[:, :20].unique().tolist() == [-1, 0, 1]
    assert buffer.segment[:, 20:].unique().tolist() == [-1, 0, 1, 2]


def test_a_line_through_the_camera_is_cut_at_the_near_plane(camera):
    """A line that recedes along a pixel row from beside the camera fills the row up to the border of the image."""
    points = torch.tensor([[[0.3, 0.0, 1.5], [0.0, 0.0, 0.0]]])
    buffer = rasterise_lines(points, camera)
    rows, columns = torch.nonzero(buffer.segment == 0).unbind(1)
    assert columns.tolist() == list(range(20, 40))
    assert set(rows.tolist()) <= {15, 16}
    world = visible_points(buffer, points).world
    assert (world[:, 2] < 1.0).all()
    pixels, _ = camera.project(world)
    torch.testing.assert_close(pixels[:, 0], columns + 0.5, rtol=0, atol=1e-2)


def test_strands_that_are_not_finite_are_not_drawn(generator, camera):
    good = wavy(generator, 6) * 0.5
    bad = good.clone()
    bad[1, 3, 0] = torch.nan
    bad[4, 5, 1] = torch.inf
    bad[5] = -torch.inf
    buffer = rasterise_lines(bad, camera)
    kept = torch.ones(6, 11, dtype=torch.bool)
    kept[1, 2:4] = kept[4, 4:6] = kept[5] = False
    drawn = buffer.segment[buffer.segment >= 0].unique()
    assert kept.view(-1)[drawn].all()
    pieces = torch.stack([good[:, :-1], good[:, 1:]], dim=2).view(-1, 2, 3)[kept.view(-1)]
    same_pixels = (rasterise_lines(pieces, camera).segment >= 0) == (buffer.segment >= 0)
    assert same_pixels.all()


def test_nothing_to_see(camera):
    empty = rasterise_lines(torch.zeros(0, 100, 3), camera)
    behind = rasterise_lines(torch.rand(5, 10, 3) + torch.tensor([0.0, 0.0, 1.1]), camera)
    for buffer in (empty, behind):
        assert (buffer.segment == -1).all()
        assert buffer.depth.isinf().all()
        assert not buffer.position.any()
        assert len(visible_points(buffer, torch.zeros(0, 100, 3))) == 0


def test_thread_count_does_not_change_a_bit(generator):
    camera = Camera.look_at(torch.tensor([0.05, 0.02, 0.8]), torch.zeros(3), 300.0, (200, 150))
    points, threads = wavy(generator), torch.get_num_threads()
    try:
        buffers = []
        for count in (1, 2, 3):
            torch.set_num_threads(count)
            buffers.append(rasterise_lines(points, camera))
    finally:
        torch.set_num_threads(threads)
    for other in buffers[1:]:
        assert torch.equal(other.segment, buffers[0].segment)
        assert torch.equal(other.position, buffers[0].position)
        assert torch.equal(other.depth, buffers[0].depth)


@pytest.mark.parametrize("distance", [0.8, 0.1, 0.0])
def test_batches_draw_the_same_keys_as_segments(generator, distance):
    """Strands of more than one batch, in front of the camera and through it, across the borders, some not finite."""
    camera = Camera.look_at(torch.tensor([0.05, 0.02, distance]), torch.tensor([0.0, 0.0, -0.5]), 250.0, (200, 150))
    points = wavy(generator, 200, 150)
    points[3, 70, 1] = torch.nan
    points[4, 20] = torch.inf
    cpu = torch.device("cpu")
    keys = [empty_keys(150, 200, cpu) for _ in range(2)]
    no_t = kernels.array(torch.zeros(0))
    matrix = projection_matrix(camera, cpu)
    drawn = [kernels.array(points.view(-1, 3), wp.vec3), kernels.array(matrix[None], wp.mat44)]
    size = [200, 150]
    kernels.launch(
        draw_lines, 200, [0, *drawn, 0.01, 0.0, 0.0, no_t, 150, 1, 149, *size, kernels.array(keys[0].view(-1))], "cpu"
    )
    kernels.launch(draw_strands, 200, [0, *drawn, 0.01, 150, *size, kernels.array(keys[1].view(-1))], "cpu")
    assert (key_index(keys[0]) >= 0).sum() > 500
    assert torch.equal(keys[0], keys[1])


def test_wrong_shapes_are_named(camera):
    with pytest.raises(ValueError, match="at least two points, found 1"):
        rasterise_lines(torch.zeros(3, 1, 3), camera)
    with pytest.raises(ValueError, match=r"\(5, 5\), the camera's image is \(32, 40\)"):
        rasterise_lines(torch.zeros(3, 4, 3), camera, torch.ones(5, 5))
