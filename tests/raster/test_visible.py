import numpy as np
import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import directions
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.raster.splat import splat, splat_pyramid
from neural_strands.raster.visible import Room, interpolate_knots, visible_points

SIZE = (48, 40)


@pytest.fixture
def camera():
    return Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 120.0, SIZE)


def wavy(generator, count=60, points=10):
    start = torch.randn(count, 1, 3, generator=generator) * 0.08
    return start + (torch.randn(count, points, 3, generator=generator) * 0.02).cumsum(1)


def line(camera, ends, count=20, depth=1.0):
    """One strand along a straight line of the image."""
    pixels = torch.lerp(torch.tensor(ends[0]), torch.tensor(ends[1]), torch.linspace(0, 1, count)[:, None])
    return camera.unproject(pixels, torch.full((count,), depth))[None]


def test_points_blend_the_ends_of_their_segments(generator, camera):
    points = wavy(generator)
    buffer = rasterise_lines(points, camera)
    visible = visible_points(buffer, points)
    assert len(visible) == (buffer.segment >= 0).sum() > 100
    for k in range(0, len(visible), 37):
        row, column = divmod(int(visible.pixel[k]), camera.width)
        strand, vertex = divmod(int(buffer.segment[row, column]), points.shape[1] - 1)
        a = float(buffer.position[row, column])
        assert (int(visible.strand[k]), int(visible.vertex[k])) == (strand, vertex)
        torch.testing.assert_close(visible.world[k], (1 - a) * points[strand, vertex] + a * points[strand, vertex + 1])
        assert float(visible.t[k]) == pytest.approx((vertex + a) / 9, abs=1e-6)


@pytest.mark.parametrize("factor", [1, 2])
def test_a_stored_t_is_blended_between_the_ends(generator, camera, factor):
    points, fine = wavy(generator), camera.resized(SIZE[0] * factor, SIZE[1] * factor)
    buffer = rasterise_lines(points, fine)
    t = torch.rand(60, 10, generator=generator).sort(dim=1).values
    visible = visible_points(buffer, points, factor, t)
    assert len(visible) > 100
    for k in range(0, len(visible), 23):
        row, a = t[int(visible.strand[k])], float(visible.position[k])
        vertex = int(visible.vertex[k])
        assert float(visible.t[k]) == pytest.approx((1 - a) * float(row[vertex]) + a * float(row[vertex + 1]), abs=1e-6)
    even = torch.linspace(0, 1, 10).expand(60, 10)
    torch.testing.assert_close(
        visible_points(buffer, points, factor, even).t, visible_points(buffer, points, factor).t, rtol=0, atol=1e-6
    )


@pytest.mark.parametrize("factor", [2, 3, 4])
def test_line_pixels_of_an_image_pixel_are_gathered(generator, device, factor):
    """Compared with sets: a part of two segments in a pixel is one point, in the middle of its line pixels."""
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 120.0, SIZE)
    points, fine = wavy(generator), camera.resized(SIZE[0] * factor, SIZE[1] * factor)
    buffer = rasterise_lines(points.to(device), fine.to(device), config=LineConfig(width=0.004))
    visible = visible_points(buffer, points.to(device), factor)
    found = {}
    segment, position = buffer.segment.tolist(), buffer.position.tolist()
    for row, column in torch.nonzero(buffer.segment >= 0).tolist():
        strand, vertex = divmod(segment[row][column], points.shape[1] - 1)
        key = (row // factor * SIZE[0] + column // factor, strand, vertex // 2)
        found.setdefault(key, []).append(vertex + position[row][column])
    assert len(visible) == len(found) > 500
    assert visible.pixel.tolist() == sorted(visible.pixel.tolist())
    rows = (visible.pixel, visible.strand, visible.vertex, visible.position, visible.weight)
    for pixel, strand, vertex, place, weight in zip(*(each.tolist() for each in rows), strict=True):
        # The mean of places on both segments of a part may be the end of the first, which is the start of the second.
        there = found.get((pixel, strand, vertex // 2))
        assert there is not None
        assert weight == len(there)
        assert vertex + place == pytest.approx(sum(there) / len(there), abs=1e-4)


def test_gathered_points_lie_where_they_are_seen(generator, camera):
    """Straight strands: the point is inside the pixel, or beyond it by at most half the strand's width."""
    ends = torch.randn(60, 2, 1, 3, generator=generator) * 0.1
    points = torch.lerp(ends[:, 0], ends[:, 1], torch.linspace(0, 1, 10)[None, :, None])
    buffer = rasterise_lines(points, camera.resized(SIZE[0] * 3, SIZE[1] * 3), config=LineConfig(width=0.004))
    visible = visible_points(buffer, points, 3)
    assert len(visible) > 500
    assert visible.weight.sum() == (buffer.segment >= 0).sum()
    pixels, depth = camera.project(visible.world)
    offset = (pixels - camera.pixel_centres().view(-1, 2)[visible.pixel]).abs().amax(dim=1)
    assert (offset <= 0.5 + 0.5 * 0.004 * 120 / depth + 1e-3).all()


def test_a_buffer_that_holds_no_whole_pixels_is_refused(generator, camera):
    points = wavy(generator)
    with pytest.raises(ValueError, match=r"\(40, 48\) has no whole pixels of 7 x 7"):
        visible_points(rasterise_lines(points, camera), points, 7)


@pytest.mark.parametrize("factor", [1, 2])
def test_points_have_as_much_room_as_is_given(generator, camera, device, factor):
    points, camera = wavy(generator).to(device), camera.to(device)
    buffer = rasterise_lines(points, camera)
    exact = visible_points(buffer, points, factor)
    names, count = ("pixel", "segment", "position", "weight", "world"), len(exact)
    roomy = visible_points(buffer, points, factor, room=Room(count + 7, count))
    assert exact.found is None
    assert roomy.found.read()[0] == count > 20
    assert len(roomy) == count + 7
    assert not roomy.weight[count:].cpu().any()
    for name in names:
        torch.testing.assert_close(getattr(roomy, name)[:count].cpu(), getattr(exact, name).cpu(), atol=1e-6, rtol=0)
    tight = visible_points(buffer, points, factor, room=Room(count - 7, count))
    assert tight.found.read()[0] == count
    assert len(tight) == count - 7
    kept = int((tight.weight.cpu() > 0).sum())
    assert kept > count - 20
    for name in names:
        assert torch.equal(getattr(tight, name)[:kept].cpu(), getattr(roomy, name)[:kept].cpu()), name


def blended(values, visible):
    """Values given at the strands' points, blended between the ends of each visible point's segment."""
    ends = values[visible.strand, visible.vertex], values[visible.strand, visible.vertex + 1]
    return torch.lerp(*ends, visible.position[:, None])


@pytest.mark.parametrize("knots", [1, 2, 5])
def test_knots_blend_along_the_strand(generator, camera, knots):
    points = wavy(generator)
    visible = visible_points(rasterise_lines(points, camera), points)
    values = torch.randn(len(points), knots, 3, generator=generator)
    found = interpolate_knots(values, visible.strand, visible.t)
    for k in range(0, len(visible), 29):
        row = values[int(visible.strand[k])].numpy()
        t, at = float(visible.t[k]), np.linspace(0, 1, knots)
        expected = [np.interp(t, at, row[:, channel]) for channel in range(3)]
        assert found[k].tolist() == pytest.approx(expected, abs=1e-5)
    tips = interpolate_knots(values, visible.strand, torch.ones_like(visible.t))
    torch.testing.assert_close(tips, values[visible.strand, -1])


def test_hidden_points_get_no_gradient(generator, camera):
    points = wavy(generator).requires_grad_()
    values = torch.randn(60, 10, 4, generator=generator).requires_grad_()
    buffer = rasterise_lines(points, camera, torch.full((SIZE[1], SIZE[0]), 1.0))
    visible = visible_points(buffer, points)
    pixels, _ = camera.project(visible.world)
    features = torch.cat([blended(values, visible), blended(directions(points), visible)], dim=1)
    planes = [plane for found in splat_pyramid(pixels, features, (SIZE[1], SIZE[0]), 3) for plane in found]
    torch.stack([plane.square().sum() for plane in planes]).sum().backward()
    seen = torch.zeros(60, 10, dtype=torch.bool)
    seen[visible.strand, visible.vertex] = True
    seen[visible.strand, visible.vertex + 1] = True
    assert values.grad is not None
    assert torch.equal(values.grad.abs().sum(-1) > 0, seen)
    # A direction at the far end of a segment also depends on the point after it.
    seen[visible.strand, (visible.vertex + 2).clamp(max=9)] = True
    assert points.grad is not None
    assert not points.grad[~seen].any()
    assert points.grad[seen].any(dim=-1).float().mean() > 0.9


@pytest.mark.parametrize("ends", [([4.0, 20.3], [44.0, 24.1]), ([20.3, 4.0], [16.2, 36.0])])
def test_image_loss_of_a_moved_strand_falls_as_finite_differences_say(camera, ends):
    """A strand half a pixel off its target across its length: the gradient equals the loss of redrawn strands."""
    size = (SIZE[1], SIZE[0])
    across = torch.tensor([0.0, -1.0, 0.0] if ends[1][0] > ends[1][1] else [1.0, 0.0, 0.0]) / 120
    strand = line(camera, ends)

    def image(points):
        visible = visible_points(rasterise_lines(points, camera), points)
        pixels, _ = camera.project(visible.world)
        found = splat(pixels, visible.t[:, None] + 0.5, size)
        return torch.cat([found.features * found.coverage.clamp(max=1.0), found.coverage[None]])

    target = image(strand + 0.5 * across)

    def loss(offset):
        return (image(strand + offset * across) - target).square().sum()

    offset = torch.tensor(0.0, requires_grad=True)
    (gradient,) = torch.autograd.grad(loss(offset), offset)
    step = 2e-3
    difference = (loss(torch.tensor(step)) - loss(torch.tensor(-step))) / (2 * step)
    assert gradient.item() < 0
    assert gradient.item() == pytest.approx(difference.item(), rel=0.05)
    assert loss(torch.tensor(0.25)) < 0.5 * loss(torch.tensor(0.0))


def pyramid_loss(found, target):
    return sum((a.coverage - b.coverage).square().sum() for a, b in zip(found, target, strict=True))


def descend(parameter, loss, rate, steps=150):
    optimiser = torch.optim.Adam([parameter], lr=rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        optimiser.zero_grad()
        loss(parameter).backward()
        optimiser.step()
        schedule.step()
    return parameter.detach()


def distance_to_line(pixels, ends):
    along = torch.nn.functional.normalize(ends[1] - ends[0], dim=0)
    return ((pixels - ends[0]) @ torch.stack([-along[1], along[0]])).abs()


def test_a_strand_three_pixels_off_is_pulled_onto_its_target_by_splat_alone():
    """A curve in the image (quadratic, three control points), 3 px off on average, comes to lie on its target."""

    def bernstein(count):
        t = torch.linspace(0, 1, count)[:, None]
        return torch.cat([(1 - t) ** 2, 2 * t * (1 - t), t**2], dim=1)

    basis = bernstein(60)
    truth = torch.tensor([[8.0, 12.0], [22.0, 10.0], [40.0, 30.0]])

    def maps(control):
        return splat_pyramid(basis @ control, torch.ones(60, 1), (SIZE[1], SIZE[0]), 4)

    target = maps(truth)
    start = (truth + torch.tensor([[0.0, -4.0], [0.0, -1.0], [0.0, -4.0]])).requires_grad_()
    found = basis @ descend(start, lambda control: pyramid_loss(maps(control), target), 0.3, 300)
    assert torch.cdist(found, bernstein(1000) @ truth).amin(dim=1).max() < 0.1


def test_a_drawn_strand_three_pixels_off_is_pulled_onto_its_target(camera):
    """A straight strand, free to move its two ends, redrawn at every step."""
    truth = line(camera, ([8.0, 12.3], [40.0, 26.6]))

    def maps(ends):
        points = torch.lerp(ends[:1], ends[1:], torch.linspace(0, 1, 20)[:, None])[None]
        visible = visible_points(rasterise_lines(points, camera), points)
        pixels, _ = camera.project(visible.world)
        return splat_pyramid(pixels, torch.ones(len(visible), 1), (SIZE[1], SIZE[0]), 4)

    target = maps(truth[0, [0, -1]])
    start = (truth[0, [0, -1]] + torch.tensor([0.0, -3.0 / 120, 0.0])).requires_grad_()
    found = descend(start, lambda ends: pyramid_loss(maps(ends), target), 1e-3)
    pixels, ends = camera.project(found)[0], camera.project(truth[0, [0, -1]])[0]
    assert distance_to_line(pixels, ends).max() < 0.15
