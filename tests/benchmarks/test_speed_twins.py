"""Twins of the speed benchmarks: they do the same work, and are timed in turn."""

import time
from dataclasses import replace

import pytest
import torch
from tiny_hair import tiny_hair_model

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import nearest_reference
from neural_strands.model.hair_volume import hair_volume


def test_work_and_twin_take_turns_and_the_lowest_counts(benchmark_module, monkeypatch):
    beside, clock, order = benchmark_module("speed", "beside"), [0.0], []
    seconds = {"ours": iter([9.0, 0.3, 0.1, 0.2]), "theirs": iter([9.0, 0.5, 0.6, 0.4])}
    monkeypatch.setattr(time, "process_time", lambda: clock[0])

    def work(name):
        def run():
            order.append(name)
            clock[0] += next(seconds[name])

        return run

    row = beside.beside("work", work("ours"), ("a twin", work("theirs")), runs=3)
    assert order == ["ours", "theirs"] * 4
    assert (row.ours, row.theirs) == pytest.approx((100.0, 400.0))
    alone = beside.Beside("other", 2.0)
    table = beside.beside_table([row, alone]).splitlines()
    assert table == [
        "processor ms   ours   twin  ratio  what the twin is",
        "work          100.0  400.0    4.0            a twin",
        "other           2.0",
    ]


def test_a_frame_by_plain_torch_is_the_same_frame(benchmark_module):
    plain, model = benchmark_module("speed", "plain"), tiny_hair_model()
    model.config = replace(model.config, mixed_precision=False)
    camera = Camera.look_at(torch.tensor([0.0, 0.1, 0.6]), torch.zeros(3), 100.0, (64, 48))
    with torch.no_grad():
        strands = model.decode()
        volume = hair_volume(strands.points)
        ours = model.render(strands, camera, volume=volume).rgb
        with plain.plain_torch():
            torch.testing.assert_close(model.decode().points, strands.points, atol=1e-6, rtol=0)
            theirs = model.render(strands, camera, volume=volume).rgb
        # A few line pixels that two segments share at the same depth may go to either.
        assert float((ours - theirs).abs().mean()) < 1e-4
        assert torch.equal(model.render(strands, camera, volume=volume).rgb, ours)


def test_trees_find_the_neighbours_of_the_grid(benchmark_module, generator):
    twins = benchmark_module("speed", "fit_step_twins")
    points, queries = torch.rand(200, 3, generator=generator), torch.rand(90, 3, generator=generator)
    grid = PointGrid.build(points, 0.2)
    triangle = Mesh(torch.rand(3, 3, generator=generator), torch.tensor([[0, 1, 2]]))
    parameter = torch.nn.Parameter(torch.zeros(2))
    found = twins.StepTwins(triangle, grid, grid, points.view(20, 10, 3), torch.optim.Adam([parameter]))
    distance, index = found._nearest(queries, grid, 0.1)
    expected = nearest_reference(queries, points, 0.1)
    assert 0 < int((index < 0).sum()) < 90
    assert torch.equal(index, expected[1])
    torch.testing.assert_close(distance, expected[0])


def test_views_are_spread_over_the_capture(benchmark_module):
    lmvs = benchmark_module("speed", "lmvs")
    assert lmvs.spread(4, 10) == [0, 2, 5, 7]
    assert lmvs.spread(10, 10) == list(range(10))
