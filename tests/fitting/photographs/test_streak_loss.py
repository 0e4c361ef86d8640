"""Streaks of photographs against stripes and lines of known direction."""

import math
from dataclasses import replace

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_model import first_model
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.photographs.streak_loss import SMOOTH, StreakConfig, Streaks, find_streaks, streak_loss
from neural_strands.fitting.seen_points import front_segments
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View
from neural_strands.prior.vae import load_prior
from neural_strands.raster.lines import rasterise_lines

SIDE = 96


def camera_at(x, z):
    """A camera half a metre from the origin that looks at it, y down."""
    position = torch.tensor([x, 0.0, z])
    ahead = -position / position.norm()
    down = torch.tensor([0.0, 1.0, 0.0])
    rotation = torch.stack([torch.linalg.cross(down, ahead), down, ahead])
    pose = torch.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ position
    focal = torch.tensor([[200.0, 0.0, SIDE / 2], [0.0, 200.0, SIDE / 2], [0.0, 0.0, 1.0]])
    return Camera(intrinsics=focal, world_to_camera=pose, width=SIDE, height=SIDE, name=f"{x}")


FRONT, SIDEWAYS = camera_at(0.0, -0.5), camera_at(0.5, 0.0)


def lines_of(direction, count=9, points=5):
    """Parallel lines of 8 cm through places about the origin."""
    along = torch.linspace(-0.04, 0.04, points)[None, :, None] * torch.nn.functional.normalize(direction, dim=0)
    return torch.linspace(-0.03, 0.03, count)[:, None, None] * torch.tensor([1.0, 0.0, 1.0]) + along


def streaks_everywhere(camera, angle, confidence=1.0):
    pixel = torch.arange(SIDE * SIDE, dtype=torch.int32)
    doubled = confidence * torch.tensor([math.cos(2 * angle), math.sin(2 * angle)])
    return Streaks(camera, pixel, doubled.expand(len(pixel), 2).half(), torch.full((len(pixel),), math.inf))


def loss_of(strands, views, row=None, pixels=20_000):
    row = torch.arange(len(strands)) if row is None else row
    fronts = [rasterise_lines(strands.detach(), view.camera).segment for view in views]
    return streak_loss(strands, row, views, fronts, pixels, torch.Generator().manual_seed(0))


@pytest.mark.parametrize("degrees", [10.0, 65.0, 140.0])
def test_stripes_have_the_direction_in_which_they_run(degrees):
    angle = math.radians(degrees)
    centres = FRONT.pixel_centres()
    across = centres[..., 1] * math.cos(angle) - centres[..., 0] * math.sin(angle)
    image = (0.5 + 0.4 * torch.sin(2 * math.pi * across / 4.0))[..., None].expand(-1, -1, 3)
    hair = torch.zeros(SIDE, SIDE, dtype=torch.bool)
    hair[20:70, 30:80] = True
    body = torch.rand(SIDE, SIDE)
    found = find_streaks(View(FRONT, image), hair, body)
    assert torch.equal(found.pixel.long(), hair.reshape(-1).nonzero().squeeze(1))
    assert torch.equal(found.body_depth(), torch.where(hair, body, math.inf))
    direction = found.streak.float()
    expected = torch.tensor([math.cos(2 * angle), math.sin(2 * angle)])
    assert (direction.norm(dim=-1) > 0.5).all()
    assert (torch.nn.functional.normalize(direction, dim=-1) @ expected > math.cos(math.radians(4))).all()


@pytest.mark.parametrize("degrees", [0.0, 20.0, 90.0])
def test_the_loss_is_the_sine_of_the_angle_times_confidence(degrees):
    vertical = lines_of(torch.tensor([0.0, 1.0, 0.0]))
    streaks = streaks_everywhere(FRONT, math.radians(90.0 + degrees), confidence=0.5)
    expected = 0.5 * math.sqrt(math.sin(math.radians(degrees)) ** 2 + SMOOTH)
    assert float(loss_of(vertical, [streaks])) == pytest.approx(expected, rel=5e-3)


def test_confidence_and_foreshortening_are_weights():
    # One line in the plane of the picture, one that rises from it by 60 degrees: half as long in the picture.
    flat = torch.tensor([[-0.03, -0.04, 0.0], [-0.03, 0.04, 0.0]])
    rising = torch.tensor([[0.0, -0.01, -0.01 * math.sqrt(3)], [0.0, 0.01, 0.01 * math.sqrt(3)]])
    strands = torch.stack([flat, rising])
    streaks = streaks_everywhere(FRONT, math.radians(60.0))
    weak = streaks.streak.clone()
    left = streaks.pixel.long() % SIDE < SIDE // 2
    weak[left] = 0.25 * weak[left]
    front = rasterise_lines(strands, FRONT).segment
    pixels = torch.stack([(front == 0).sum(), (front == 1).sum()])
    shown = pixels * torch.tensor([0.25, 0.5])
    # The streaks of the right half now run upwards, like the line there, so that only the left one errs.
    upright = torch.tensor([-1.0, 0.0]).half()
    weak[~left] = upright
    sine = torch.tensor([math.sin(math.radians(30)) ** 2 + SMOOTH, SMOOTH]).sqrt()
    loss = loss_of(strands, [replace(streaks, streak=weak)], pixels=400_000)
    assert float(loss) == pytest.approx(float((shown * sine).sum() / pixels.sum()), rel=0.03)


def test_two_views_tell_the_direction_in_space():
    true = torch.nn.functional.normalize(torch.tensor([0.5, 1.0, -0.7]), dim=0)
    points = lines_of(true)
    views = []
    for camera in (FRONT, SIDEWAYS):
        pixels, _ = camera.project(points[4])
        x, y = (pixels[-1] - pixels[0]).tolist()
        views.append(streaks_everywhere(camera, math.atan2(y, x)))
    direction = torch.tensor([0.0, 1.0, 0.0], requires_grad=True)
    optimiser = torch.optim.Adam([direction], lr=0.03)
    for _ in range(120):
        optimiser.zero_grad()
        loss_of(lines_of(direction), views, pixels=2000).backward()
        optimiser.step()
    found = torch.nn.functional.normalize(direction.detach(), dim=0)
    assert float((found @ true).abs()) > math.cos(math.radians(3))


def placed(streaks, device):
    tensors = {name: getattr(streaks, name).to(device) for name in ("camera", "pixel", "streak", "body")}
    return replace(streaks, **tensors)


def test_what_is_hidden_or_not_decoded_has_no_gradient(device):
    strands = lines_of(torch.tensor([0.3, 1.0, 0.0])).to(device).requires_grad_()
    front = placed(streaks_everywhere(FRONT, 0.0), device)
    row = torch.full((9,), -1)
    row[4] = 0
    row, part = row.to(device), strands[4:5]
    segment = rasterise_lines(strands.detach(), front.camera).segment
    streak_loss(part, row, [front], [segment], 20_000, torch.Generator().manual_seed(0)).backward()
    assert strands.grad is not None
    moved = strands.grad.cpu().abs().sum(dim=(1, 2)) > 0
    assert moved.tolist() == [place == 4 for place in range(9)]
    nothing = streak_loss(part, row, [front], [torch.full_like(segment, -1)], 20_000, torch.Generator().manual_seed(0))
    assert float(nothing.detach()) == 0.0
    none = Streaks(FRONT, torch.zeros(0, dtype=torch.int32), torch.zeros(0, 2).half(), torch.zeros(0))
    empty = placed(none, device)
    assert float(streak_loss(part, row, [empty], [segment], 100, torch.Generator()).detach()) == 0.0


def test_a_fit_finds_the_streaks_of_its_training_views(tmp_path):
    strands = write_capture(tmp_path / "ball")
    capture, config = Capture.load(tmp_path / "ball"), tiny_config(hold_out_every=3)
    inputs = capture, find_head(capture), true_segments(strands)
    unused = replace(config, weights=replace(config.weights, streaks=0.0))
    assert gather_fit_data(*inputs, unused, torch.device("cpu")).streaks == ()
    small = replace(config, streaks=StreakConfig(longest_side=32))
    data = gather_fit_data(*inputs, small, torch.device("cpu"))
    assert len(data.streaks) == len(data.views) == 4
    assert len(gather_fit_data(*inputs, small, torch.device("cpu"), streak_views=2).streaks) == 2
    for view, streaks in zip(data.views.reduced(32), data.streaks, strict=True):
        assert (streaks.camera.width, streaks.camera.height) == (32, 32)
        assert view.hair_mask is not None
        assert torch.equal(streaks.pixel.long(), (view.hair_mask > 0.5).reshape(-1).nonzero().squeeze(1))


def test_strands_that_the_kept_body_hides_are_those_that_the_drawn_body_hides(tmp_path):
    strands = write_capture(tmp_path / "ball")
    capture, config = Capture.load(tmp_path / "ball"), tiny_config(hold_out_every=3)
    data = gather_fit_data(capture, find_head(capture), true_segments(strands), config, torch.device("cpu"))
    model = first_model(data, load_prior(), config)
    drawn = model.decode(20).points.detach()
    for streaks in data.streaks:
        pixel = streaks.pixel.long()
        kept = front_segments(model, drawn, streaks.camera, streaks.body_depth()).view(-1)[pixel]
        assert torch.equal(kept, front_segments(model, drawn, streaks.camera).view(-1)[pixel])
        assert (kept != rasterise_lines(drawn, streaks.camera).segment.view(-1)[pixel]).any()
