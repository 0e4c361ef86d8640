"""Estimates the time of line-based multi-view stereo from a trial on a few reduced photographs."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.hold_out import training_views
from neural_strands.fitting.config import FitConfig
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.views import Views
from neural_strands.lmvs.reconstruct import reconstruct
from neural_strands.scalp.head import Head

TRIAL_VIEWS = 9
"""Number of views in the trial: one, and the eight neighbours with which it is compared."""
TRIAL_SIDE = 96
"""Longer side of the photographs in the trial, pixels; on smaller ones, constant costs would dominate."""
WARM_UP_VIEWS = 3
"""Number of views in an untimed first round, which loads the kernels."""


def stereo_seconds(
    capture: Capture,
    head: Head,
    config: FitConfig,
    device: torch.device,
    clock: Callable[[], float] = time.perf_counter,
) -> float | None:
    """Estimate the seconds that stereo over the training views will take on this device.

    The time for reading is proportional to the number of photographs, everything else to their pixels.

    Args:
        capture: all views.
        head: mesh and scalp.
        config: configuration of the planned fit.
        device: device of the stereo.
        clock: returns the time, seconds.

    Returns:
        The estimate; None if the reduced photographs show too little hair for a trial.
    """
    seen = capture.subset(training_views(len(capture), config.hold_out_every))
    count = min(TRIAL_VIEWS, len(seen))
    few = seen.subset([k * len(seen) // count for k in range(count)])
    began = clock()
    views = list(few.views_on(device).reduced(TRIAL_SIDE))
    reading = (clock() - began) / count
    mesh, began = head.mesh.to(device), clock()
    try:
        with _without_warnings("neural_strands.lmvs"):
            for some in (views[:WARM_UP_VIEWS], views):
                began = clock()
                # Copying the result to the CPU waits for the device.
                reconstruct(Views.in_memory(some), mesh, config.stereo, torch.Generator().manual_seed(config.seed)).to(
                    "cpu"
                )
    except InputError:
        return None
    seconds = clock() - began
    tried = sum(view.camera.width * view.camera.height for view in views)
    whole = sum(camera.width * camera.height for camera in seen.cameras)
    return reading * len(seen) + seconds * whole / tried


@contextmanager
def _without_warnings(name: str) -> Iterator[None]:
    """Drop the warnings of a package's loggers: those about reduced photographs would mislead."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
