"""How often the host waits for the device in every kind of step, its backward pass and its optimiser included."""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from emulated_device import emulated_cuda, waits
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.prior.vae import load_prior

ITEM, NONZERO, MASK = "aten._local_scalar_dense.default", "aten.nonzero.default", "aten.index.Tensor by a mask"
SHAPE = {"tolist": 2, NONZERO: 6, MASK: 5, "to the device": 6}
"""A shape step: the grid of all points (its two corners, and which strands it takes from memory), visible points and
matches of the surface loss, matches of the coverage loss, streaks of four views; uploads of what was drawn at random.
"""
BLUR = {"to the device": 2}
"""The matrices of a blur, once for every width."""
IMAGE = {NONZERO: 1, ITEM: 2, "to the CPU": 1, "to the device": 1}
"""An image step: the middle of the region, the number of visible parts, the camera's position."""
AFTER_SHAPE = {"tolist": 1, "to the device": 1}
"""The first image step after the shape has changed: the box of the hair."""
VISIBLE_STRANDS = {NONZERO: 1}
"""A step of both kinds: which strands the region sees."""
DECODED = {"to the device": 1}
"""A step of both kinds: which of the points that were decoded again are remembered."""
READ = {"tolist": 1}
"""The figures of a step."""


@pytest.fixture(scope="module")
def counted(tmp_path_factory) -> list[dict[str, int]]:
    """What the host waited for in each of ten steps; images begin at the fifth, and the shape moves in every third."""
    folder = tmp_path_factory.mktemp("capture") / "ball"
    write_capture(folder)
    config = tiny_config(steps=10, initialise="mean", shape_every=3)
    model = replace(config.model, mixed_precision=False, supersample=3)
    config = replace(config, model=model, schedule=replace(config.schedule, geometry_only=0.4))
    found: list[dict[str, int]] = []

    def after_step(*_: object) -> None:
        found.append(dict(waits))
        waits.clear()

    with emulated_cuda() as device:
        capture = Capture.load(folder)
        segments = true_segments(capture.ground_truth.points)
        data = gather_fit_data(capture, find_head(capture, None), segments, config, device)
        state = begin(data, load_prior(None, device), config)
        waits.clear()
        fit(state, data, config, structural_loss, after_step=after_step)
    return found


def total(*parts: dict[str, int]) -> dict[str, int]:
    return dict(sum(map(Counter, parts), Counter()))


@pytest.mark.slow(seconds=20)
@pytest.mark.parametrize(
    ("step", "expected"),
    [
        (1, total(SHAPE, BLUR, READ)),
        (3, total(SHAPE, BLUR, READ)),
        (5, total(IMAGE, BLUR, AFTER_SHAPE, READ)),
        (6, total(IMAGE, BLUR, READ)),
        (7, total(SHAPE, IMAGE, BLUR, VISIBLE_STRANDS, DECODED, READ)),
        (9, total(IMAGE, BLUR, READ)),
    ],
)
def test_waits_of_a_step(counted, step, expected):
    assert counted[step] == expected


@pytest.mark.parametrize(
    ("work", "expected"),
    [
        (lambda values: values.sum().item(), {ITEM: 1}),
        (lambda values: float(values[0]), {ITEM: 1}),
        (lambda values: values.tolist(), {"tolist": 1}),
        (lambda values: values.cpu(), {"to the CPU": 1}),
        (lambda values: values.nonzero(), {NONZERO: 1}),
        (lambda values: values[values > 0], {MASK: 1}),
        (lambda values: values + torch.ones(3).to(values.device), {"to the device": 1}),
        (lambda values: values.new_tensor([1.0, 2.0, 3.0]), {"to the device": 1}),
        (lambda values: torch.ones(3).to(values.device, non_blocking=True), {"to the device": 1}),
        (lambda values: torch.ones(3).pin_memory().to(values.device, non_blocking=True), {}),
        (lambda values: values.copy_(torch.ones(3)), {"copy_ between devices": 1}),
        (lambda values: values.__setitem__(0, 2.0), {}),
        (lambda values: values.square().where(values > 0, 1.0).sum(), {}),
    ],
)
def test_every_kind_of_wait_is_counted(emulated, work: Callable[[torch.Tensor], object], expected):
    values = torch.tensor([-1.0, 0.5, 2.0]).to(emulated)
    waits.clear()
    work(values)
    assert dict(waits) == expected
