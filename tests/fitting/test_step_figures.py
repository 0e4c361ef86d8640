"""Figures of steps that are read several at a time."""

import time

import torch
from emulated_device import waits

from neural_strands.fitting.step_figures import StepFigures


def test_figures_are_read_at_once_in_order(emulated):
    figures = StepFigures(3)
    for step in (1, 2, 3):
        assert not figures.due
        figures.begin()
        named = {"coverage": 0.5 * step} if step == 2 else {"coverage": 0.5 * step, "render": 0.25 * step}
        figures.add(step, {name: torch.tensor(value).to(emulated) for name, value in named.items()})
    assert figures.due
    waits.clear()
    rows = figures.read()
    assert dict(waits) == {"tolist": 1}
    assert [{name: value for name, value in row.items() if name != "seconds"} for row in rows] == [
        {"coverage": 0.5, "render": 0.25, "step": 1.0},
        {"coverage": 1.0, "step": 2.0},
        {"coverage": 1.5, "render": 0.75, "step": 3.0},
    ]
    assert not figures.due
    assert figures.read() == []


def test_seconds_are_the_mean_of_steps_that_are_read_together(monkeypatch):
    clock = iter([10.0, 16.0, 20.0, 21.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    figures = StepFigures(2)
    for step in (1, 2):
        figures.begin()
        figures.add(step, {"render": torch.zeros(())})
    assert [row["seconds"] for row in figures.read()] == [3.0, 3.0]
    figures.begin()
    figures.add(3, {"render": torch.zeros(())})
    assert [row["seconds"] for row in figures.read()] == [1.0]
