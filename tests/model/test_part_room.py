"""Frames with room for a fixed number of visible parts of strands."""

from dataclasses import dataclass, replace

import pytest
import torch
from emulated_device import operations, waits
from tiny_hair import tiny_hair_model

from neural_strands.foundation.devices.late_numbers import LateNumbers
from neural_strands.geometry.cameras import Camera
from neural_strands.model.outputs import RenderOutput
from neural_strands.model.part_room import UNIT, PartRoom
from neural_strands.model.renderer import HairRenderer
from neural_strands.raster.lines import LineBuffer
from neural_strands.raster.visible import Room

CUDA = torch.device("cuda")


def view(distance: float = 0.6) -> Camera:
    return Camera.look_at(torch.tensor([0.0, 0.1, distance]), torch.zeros(3), 100.0, (64, 48))


def test_numbers_arrive_without_a_wait_for_what_follows(device):
    numbers = torch.arange(6).to(device).view(2, 3).sum(1)
    waits.clear()
    late = LateNumbers(numbers)
    assert not waits
    assert late.read() == [3, 12]


@dataclass
class Frames:
    """Renders nothing, and finds so many parts and nodes in one frame after the other."""

    found: list[tuple[int, int]]

    def __post_init__(self) -> None:
        self.rooms: list[Room | None] = []

    def __call__(self, room: Room | None) -> RenderOutput:
        self.rooms.append(room)
        picture, plane = torch.full((1, 1, 3), float(0 if room is None else room.points)), torch.zeros(1, 1)
        lines = LineBuffer(plane.long(), plane, plane)
        number = LateNumbers(torch.tensor(self.found.pop(0)))
        return RenderOutput(picture, plane, picture, picture, plane, lines, plane, number)


def test_a_frame_has_room_for_some_more_parts_than_the_one_before():
    room, pixels = PartRoom(), 100_000
    frames = Frames([(20_000, 9000), (24_000, 9000), (60_000, 9000), (60_000, 9000), (61_000, 0), (0, 0), (5, 5)])
    room.rendered(frames, pixels, CUDA)
    assert frames.rooms == [(25 * UNIT, 13 * UNIT)]
    room.rendered(frames, pixels, CUDA)
    assert frames.rooms[1:] == [(7 * UNIT, 3 * UNIT)]
    # There are more than twice as many: the frame is rendered again.
    last = room.rendered(frames, pixels, CUDA)
    assert frames.rooms[2:] == [(8 * UNIT, 3 * UNIT), (19 * UNIT, 3 * UNIT)]
    assert float(last.rgb[0, 0, 0]) == 19 * UNIT
    # A picture of four times the size has room for four times as many.
    room.rendered(frames, 4 * pixels, CUDA)
    assert frames.rooms[4:] == [(74 * UNIT, 11 * UNIT)]
    room.rendered(frames, pixels, CUDA)
    room.rendered(frames, pixels, CUDA)
    assert frames.rooms[-1] == (UNIT, UNIT)


def test_a_frame_with_more_nodes_than_there_is_room_for_is_rendered_again():
    frames = Frames([(20_000, 60_000), (20_000, 60_000)])
    PartRoom().rendered(frames, 100_000, CUDA)
    assert frames.rooms == [(25 * UNIT, 13 * UNIT), (7 * UNIT, 19 * UNIT)]


def test_on_a_cpu_nothing_is_guessed():
    frames = Frames([(20_000, 0)])
    PartRoom().rendered(frames, 100_000, torch.device("cpu"))
    assert frames.rooms == [None]


@pytest.mark.parametrize("supersample", [1, 3])
@pytest.mark.parametrize("is_broken", [False, True])
def test_room_that_is_not_needed_changes_nothing(supersample, is_broken):
    model = tiny_hair_model()
    model.config = replace(model.config, supersample=supersample, mixed_precision=False)
    with torch.no_grad():
        strands = model.decode()
        if is_broken:
            # Parts that are not there are at the first strand.
            points = strands.points.clone()
            points[0] = torch.nan
            strands = replace(strands, points=points)
        exact, roomy = model.render(strands, view()), model.render(strands, view(), room=Room(3 * UNIT, UNIT))
    assert exact.parts is None
    assert 0 < roomy.parts.read()[0] < 3 * UNIT
    assert torch.isfinite(exact.rgb).all()
    torch.testing.assert_close(roomy.rgb, exact.rgb, atol=1e-6, rtol=0)
    torch.testing.assert_close(roomy.alpha, exact.alpha, atol=1e-6, rtol=0)


def test_a_head_without_hair_is_rendered(device):
    renderer = HairRenderer.of(tiny_hair_model().to(device))
    none = torch.zeros(0, dtype=torch.int64, device=device)
    output = replace(renderer, strands=renderer.strands.select(none)).render(view())
    assert torch.isfinite(output.rgb.cpu()).all()
    assert output.coverage.cpu().max() == 0


def test_the_host_looks_after_everything_is_queued(emulated, monkeypatch):
    model = tiny_hair_model()
    model.config = replace(model.config, mixed_precision=False)
    renderer, exact = HairRenderer.of(model.to(emulated)), HairRenderer.of(tiny_hair_model())
    exact.model.config = model.config
    queued: list[int] = []
    read = LateNumbers.read

    def reading(numbers: LateNumbers) -> list[int]:
        queued.append(operations.total())
        return read(numbers)

    monkeypatch.setattr(LateNumbers, "read", reading)
    renderer.render(view())
    waits.clear()
    operations.clear()
    output = renderer.render(view())
    assert dict(waits) == {"an event": 1}
    assert queued[-1] == operations.total() > 100
    torch.testing.assert_close(output.rgb.cpu(), exact.render(view()).rgb, atol=1e-5, rtol=0)
    # From near by, there are more parts than there is room for.
    renderer.room._per_pixel = (0.0, 0.0)
    monkeypatch.setattr("neural_strands.model.part_room.UNIT", 64)
    before = len(queued)
    near = renderer.render(view(0.3))
    assert len(queued) == before + 1
    assert operations.total() > queued[-1] + 100
    torch.testing.assert_close(near.rgb.cpu(), exact.render(view(0.3)).rgb, atol=1e-5, rtol=0)
