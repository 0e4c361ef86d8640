"""Speed of simulated wind, how well strands keep their lengths, and whether any enters the body.

    python benchmarks/speed/wind.py                # strands of the shipped prior on a hemisphere
    python benchmarks/speed/wind.py --run RUN      # the hair of a run, over its head and shoulders

Prints one JSON object: wall and processor seconds of preparation and of all frames, the largest relative change of the
length of a segment (median over strands, and worst of all) of the simulated guides and of all strands, and how far the
deepest point lies inside the body after the first second, in which points that were inside at rest are led out.
"""

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import tyro
from render import Arguments as Rendering
from render import hair_model

from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.hair import Hair
from neural_strands.editing.outside import LED_OUT
from neural_strands.editing.settings import Wind
from neural_strands.editing.simulated_wind import SimulatedHair
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.geometry.strands import segments
from neural_strands.runs.edited import open_hair


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    run: Path | None = None
    """Run whose hair is used."""
    strands: int = 10_000
    """Strands, without a run."""
    frames: int = 100
    """Frames of wind."""
    guides: int = 500
    """Strands that are simulated."""
    strength: float = 1.5
    """Force of the wind over the weight of the hair."""


def stretch(points: torch.Tensor, length: torch.Tensor) -> torch.Tensor:
    """Largest relative change of the length of a segment, of each strand; segments below 0.1 mm aside."""
    change = (segments(points).norm(dim=-1) / length.clamp(min=1e-9) - 1).abs()
    return torch.where(length > 1e-4, change, 0.0).amax(dim=1)


def main(arguments: Arguments) -> None:
    """Simulate, measure and print."""
    keep_freed_memory()
    hair = (
        Hair.of(hair_model(arguments.strands, Rendering(), torch.device("cpu")))
        if arguments.run is None
        else open_hair(arguments.run).hair
    )
    wind = Wind(strength=arguments.strength, simulate=True, guides=arguments.guides, seconds=arguments.frames / 24)
    # Compile kernels before timing.
    warm = hair_motion(replace(hair, strands=hair.strands.select(torch.arange(10))), [wind])
    assert warm is not None
    warm.at(0.1)
    wall, processor = time.perf_counter(), time.process_time()
    motion = hair_motion(hair, [wind])
    assert isinstance(motion, SimulatedHair)
    figures: dict[str, object] = {
        "strands": len(hair.strands),
        "prepare": {"wall_s": round(time.perf_counter() - wall, 2), "cpu_s": round(time.process_time() - processor, 2)},
    }
    rest = segments(hair.strands.points).norm(dim=-1)
    spent, worst, worst_guide, deepest = [0.0, 0.0], torch.zeros(len(rest)), torch.zeros(len(motion.rods.rest)), 0.0
    for frame in range(wind.frames):
        seconds = frame / wind.fps
        wall, processor = time.perf_counter(), time.process_time()
        points = motion.at(seconds)
        spent = [spent[0] + time.perf_counter() - wall, spent[1] + time.process_time() - processor]
        worst = torch.maximum(worst, stretch(points, rest))
        worst_guide = torch.maximum(worst_guide, stretch(motion.guides_at(seconds), motion.rods.length))
        if motion.body is not None and seconds >= LED_OUT:
            deepest = max(deepest, -float(motion.body(points[:, 1:]).min()))
    figures["frames"] = {"count": wind.frames, "wall_s": round(spent[0], 1), "cpu_s": round(spent[1], 1)}
    figures["stretch_percent"] = {
        name: {"median": f"{100 * float(values.median()):.2g}", "worst": f"{100 * float(values.max()):.2g}"}
        for name, values in (("guides", worst_guide), ("strands", worst))
    }
    figures["deepest_mm"] = None if motion.body is None else round(1000 * deepest, 3)
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
