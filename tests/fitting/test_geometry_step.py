"""The geometric step: which strands segments may pull."""

from dataclasses import replace

import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_model import begin, fit_prior
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.geometry_step import StepStrands, shape_losses
from neural_strands.fitting.losses import OrientedTargets
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.strands import directions


def test_segments_across_strands_pull_the_mean_strand_but_not_traced_ones(tmp_path, generator):
    segments = true_segments(write_capture(tmp_path))
    capture, config, cpu = Capture.load(tmp_path), tiny_config(initialise="mean"), torch.device("cpu")
    data = gather_fit_data(capture, find_head(capture), segments, config, cpu)
    state = begin(data, fit_prior(None, cpu), config)
    strands = state.remembered
    points, along = strands.reshape(-1, 3), directions(strands).reshape(-1, 3)
    across = torch.nn.functional.normalize(
        torch.linalg.cross(along, torch.randn(along.shape, generator=generator)), dim=-1
    )
    grid = PointGrid.build(points, config.chamfer.surface_radius)
    data = replace(data, targets=OrientedTargets(points, across, grid))
    chosen = StepStrands.drawn(len(strands), len(strands), generator, cpu)
    every, seen = torch.arange(len(points)), torch.ones(strands.shape[:2], dtype=torch.bool)

    def losses(start):
        started = replace(config, initialise=start)
        found = shape_losses(strands[chosen.index], chosen, strands, strands, seen, data, every, started)
        return float(found.surface), float(found.coverage)

    assert losses("flow") == (0.0, 0.0)
    assert min(losses("mean")) > 0.9


def test_seen_and_hidden_points_are_held_apart(tmp_path, generator):
    segments = true_segments(write_capture(tmp_path))
    capture, config, cpu = Capture.load(tmp_path), tiny_config(), torch.device("cpu")
    data = gather_fit_data(capture, find_head(capture), segments, config, cpu)
    first = torch.randn(40, 6, 3, generator=generator)
    moved = first + 0.01 * torch.randn(first.shape, generator=generator)
    seen = torch.rand(40, 6, generator=generator) < 0.3
    chosen = StepStrands.drawn(40, 25, generator, cpu)
    targets = torch.arange(len(data.targets.points))
    found = shape_losses(moved[chosen.index], chosen, moved, first, seen, data, targets, config)
    squared = ((moved - first) / config.chamfer.unit).square().sum(dim=2)[chosen.index]
    share = seen[chosen.index]
    torch.testing.assert_close(found.first, squared[share].sum() / share.numel())
    torch.testing.assert_close(found.hidden, squared[~share].sum() / share.numel())
