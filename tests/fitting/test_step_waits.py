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
from neural_strands.fitting.photographs.regions import MarkedPixels
from neural_strands.prior.vae import load_prior

ITEM, NONZERO, MASK = "aten._local_scalar_dense.default", "aten.nonzero.default", "aten.index.Tensor by a mask"
SHAPE = {"tolist": 1}
"""A shape step: the corners of the grid of all points."""
IMAGE = {"tolist": 1}
"""An image step: the numbers of visible parts and of nodes, in one answer."""
AFTER_SHAPE = {"tolist": 1}
"""The first image step after the shape has changed: the box of the hair."""
VISIBLE_STRANDS = {NONZERO: 1}
"""A step of both kinds: which strands the region sees."""
READ = {"tolist": 1}
"""The figures of steps, as often as they are asked for."""


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
        for view in range(len(data.views)):
            # Where the hair is in a photograph is asked when it is used first.
            data.marked[view] = MarkedPixels.of(data.hair_pixels(data.views[view]))
        waits.clear()
        fit(state, data, config, structural_loss, after_step=after_step)
    return found


def total(*parts: dict[str, int]) -> dict[str, int]:
    return dict(sum(map(Counter, parts), Counter()))


@pytest.mark.slow(seconds=20)
@pytest.mark.parametrize(
    ("step", "expected"),
    [
        (1, total(SHAPE, READ)),
        (3, total(SHAPE, READ)),
        (5, total(IMAGE, AFTER_SHAPE, READ)),
        (6, total(IMAGE, READ)),
        (7, total(SHAPE, IMAGE, VISIBLE_STRANDS, READ)),
        (9, total(IMAGE, READ)),
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
