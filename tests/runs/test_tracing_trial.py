"""The forecast of tracing against a machine whose speed is known."""

import time
from types import SimpleNamespace

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.fit_data import FitData, gather_fit_data, head_distance_grid
from neural_strands.flow.field import grid_around
from neural_strands.flow.tracing import TracedStrands
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.runs import tracing_trial
from neural_strands.runs.tracing_trial import GROWTH, OF_LOOPS, tracing_seconds
from neural_strands.scalp.roots import Roots, sample_roots

CPU = torch.device("cpu")
FOR_MASKS, FOR_THE_LAYER, A_STRAND, A_COMPARISON = 0.7, 1.1, 1e-3, 2.0


class Machine:
    """A clock, and the stages of tracing, each of which takes a known time."""

    def __init__(self) -> None:
        self.now, self.spacings, self.traced = 0.0, [], 0

    def clock(self) -> float:
        return self.now

    def loops(self, voxels: int) -> float:
        """Seconds of the sweeps and rounds together."""
        return 0.2 * (voxels / 100_000) ** GROWTH

    def whole(self, voxels: int, strands: int) -> float:
        """Seconds of tracing."""
        grown = OF_LOOPS * self.loops(voxels)
        return FOR_MASKS + FOR_THE_LAYER + grown + A_STRAND * strands + 2 * A_COMPARISON

    def hair_room(self, segments, _views, _head, roots, config, _distance):
        self.now += FOR_MASKS
        self.spacings.append(config.flow.spacing)
        grid = grid_around(torch.cat([segments.points, roots]), config.flow.spacing, config.flow.margin)
        domain = torch.zeros(grid.shape, dtype=torch.bool)
        domain[2:-2, 2:-2, 2:-2] = True
        return SimpleNamespace(grid=grid, domain=domain, masked=True)

    def hair_flow(self, room, _segments, roots, _normals, _config, track):
        loops = self.loops(room.grid.count)
        self.now += FOR_THE_LAYER + (OF_LOOPS - 1) * loops
        for title, rounds in (("sweeps", 25), ("rounds", 4)):
            for _ in track(range(rounds), title, rounds):
                self.now += 0.5 * loops / rounds
        return SimpleNamespace(directions=roots)

    def trace_hair(self, _field, roots, _normals, _config):
        self.now += A_STRAND * len(roots)
        self.traced = len(roots)
        return TracedStrands(roots[:, None].expand(-1, 10, -1), torch.zeros(len(roots)))

    def along(self, *_):
        self.now += A_COMPARISON


@pytest.fixture
def known(tmp_path) -> tuple[FitData, Roots, LineSegments]:
    segments = true_segments(write_capture(tmp_path / "ball"))
    capture = Capture.load(tmp_path / "ball")
    head = find_head(capture, None)
    data = gather_fit_data(capture, head, segments, tiny_config(), CPU, head_distance_grid(head.mesh))
    return data, sample_roots(head, 4000, torch.Generator().manual_seed(0)), segments


@pytest.fixture
def machine(monkeypatch) -> Machine:
    made = Machine()
    for name in ("hair_room", "hair_flow", "trace_hair"):
        monkeypatch.setattr(tracing_trial, name, getattr(made, name))
    monkeypatch.setattr(tracing_trial.Comparison, "along", made.along)
    return made


@pytest.mark.parametrize("given", [True, False])
def test_tracing_takes_the_time_of_a_known_machine(known, machine, given):
    data, roots, segments = known
    config = tiny_config(strands=30_000)
    extent = segments.points if given else torch.tensor([[-0.2, -0.3, -0.1], [0.2, 0.1, 0.2]])
    found = tracing_seconds(data, roots, segments if given else None, extent, config, machine.clock)
    flow = config.initial.flow
    voxels = grid_around(torch.cat([extent, roots.position]), flow.spacing, flow.margin).count
    assert found == pytest.approx(machine.whole(voxels, 30_000), rel=0.02)
    # The trial itself is small.
    assert machine.spacings == [2 * flow.spacing]
    assert machine.traced == 2000
    assert machine.now < 0.5 * found


def test_the_real_stages_can_be_tried(known):
    """The trial's own time bounds the forecast: eight times as many voxels take 8 ** GROWTH, 17.6 times as long."""
    data, roots, segments = known
    for given, extent in ((segments, segments.points), (None, data.head.mesh.vertices)):
        began = time.perf_counter()
        told = tracing_seconds(data, roots, given, extent, tiny_config())
        assert 0 < told < 20 * (time.perf_counter() - began)
