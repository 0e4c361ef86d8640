"""Estimates the time of tracing first strands from a trial in coarse voxels.

Only the flow's time depends on the size of voxels. It grows faster than their number, because the flow takes more steps
to pass through more of them.
"""

import itertools
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.curls.comparison import Comparison, photographs
from neural_strands.fitting.fit_data import FitData
from neural_strands.flow.field import grid_around
from neural_strands.flow.hair_flow import hair_flow, hair_room
from neural_strands.flow.tracing import trace_hair
from neural_strands.flow.unseen import DOWN
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.scalp.roots import Roots

COARSER = 2.0
"""Size of the trial's voxels in those of the fit."""
TRIAL_STRANDS = 2000
"""Largest number of strands in the trial."""
OF_LOOPS, GROWTH = 1.9, 1.38
"""All the time that grows with the number of voxels, in that of sweeps and rounds alone; and the power of that number
with which it grows. From 4 mm to 2 mm, they predict the growth on three captures within 12%."""
TEXTURES = 2
"""Number of times that hair is compared with photographs if it is straight: as photographed, and as traced."""


@dataclass
class LoopTimer:
    """Adds up the time within loops; `track` is that of a `Feedback`.

    Attributes:
        clock: returns the time, seconds.
        seconds: the sum so far.
    """

    clock: Callable[[], float]
    seconds: float = 0.0

    def track(self, items: Iterable[Any], _description: str, _total: int) -> Iterator[Any]:
        """Yield the items, and add the time until the last is done."""
        began = self.clock()
        yield from items
        self.seconds += self.clock() - began


def tracing_seconds(
    data: FitData,
    roots: Roots,
    segments: LineSegments | None,
    extent: Float[Tensor, "point 3"],
    config: FitConfig,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Estimate the seconds that tracing first strands of straight hair will take on the device of the data.

    Args:
        data: inputs of the fit; its segments are not used.
        roots: roots on the scalp, on the device of the data.
        segments: those of the fit; None if they are not known yet. The hair is then taken to fill the room that the
            masks leave or, without masks, to lie on the head.
        extent: points as far apart as the segments are or, if these are not known, as hair usually reaches.
        config: configuration of the planned fit.
        clock: returns the time, seconds.
    """
    flow, head = config.initial.flow, data.head.mesh
    coarse = replace(config.initial, flow=replace(flow, spacing=COARSER * flow.spacing))
    some = roots.select(torch.arange(0, len(roots), max(1, len(roots) // TRIAL_STRANDS)))
    extent = extent.to(some.position)
    known = _hanging(extent) if segments is None else segments.to(extent.device)
    loops, times = LoopTimer(clock), [clock()]
    room = hair_room(known, data.views, head, some.position, coarse, data.distance)
    if segments is None:
        known = _hanging(room.grid.nodes(extent.device)[room.domain])
    field = hair_flow(room, known, some.position, some.normal, coarse, loops.track)
    times.append(_finished(field.directions, clock))
    strands = trace_hair(field, some.position, some.normal, coarse.trace).points
    times.append(_finished(strands, clock))
    if coarse.curls.find and room.masked:
        Comparison.along(strands, photographs(data.views))
    times.append(clock())
    flowing, tracing, comparing = (end - begin for begin, end in itertools.pairwise(times))
    voxels = grid_around(torch.cat([extent, some.position]), flow.spacing, flow.margin).count
    growing = min(OF_LOOPS * loops.seconds, flowing)
    grown = growing * (voxels / room.grid.count) ** GROWTH
    return flowing - growing + grown + tracing * config.strands / len(some) + TEXTURES * comparing


def _hanging(points: Float[Tensor, "point 3"]) -> LineSegments:
    """A segment at each point, downwards."""
    count = len(points)
    down = points.new_tensor(DOWN).expand(count, 3)
    return LineSegments(points, down, points.new_ones(count), torch.arange(count, device=points.device))


def _finished(result: Tensor, clock: Callable[[], float]) -> float:
    """The time when a device has finished a result: copying a part of it to the CPU waits for that."""
    result.flatten()[:1].cpu()
    return clock()
