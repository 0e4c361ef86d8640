"""Scores four million true points against one million predicted ones: time and peak memory.

    python benchmarks/speed/score.py

The grooms are made here: gently waving strands that leave a hemisphere of 10 cm, as dense as real hair is sampled; the
prediction is every fourth strand, disturbed by a few millimetres. The target is less than 90 s and 6 GB on 2 cores.
"""

import json
import math
import sys
import time

import torch

from neural_strands.evaluation.geometry_metrics import score_geometry
from neural_strands.evaluation.oriented_points import OrientedPoints, sample_strands
from neural_strands.evaluation.timing import peak_memory

TRUE_STRANDS = 10_000
POINTS = 100
LENGTH = 0.2
"""Metres; 401 samples of 0.5 mm a strand."""


def groom(strands: int, generator: torch.Generator) -> torch.Tensor:
    """Strands that leave the upper half of a ball of 10 cm and fall."""
    height = torch.rand(strands, generator=generator)
    turn = 2 * math.pi * torch.rand(strands, generator=generator)
    ring = (1 - height.square()).sqrt()
    normal = torch.stack([ring * turn.cos(), height, ring * turn.sin()], dim=-1)
    along = torch.linspace(0, 1, POINTS)[None, :, None]
    direction = (1 - along).square() * normal[:, None] + (1 - (1 - along).square()) * torch.tensor([0.0, -1.0, 0.0])
    direction = torch.nn.functional.normalize(direction, dim=-1)
    steps = direction * LENGTH / (POINTS - 1)
    path = torch.cat([torch.zeros(strands, 1, 3), steps[:, 1:].cumsum(dim=1)], dim=1)
    phase = 2 * math.pi * torch.rand(strands, 1, 1, generator=generator)
    sideways = torch.linalg.cross(normal, torch.tensor([0.0, 1.0, 0.0]).expand_as(normal))[:, None]
    return 0.1 * normal[:, None] + path + 2e-3 * along * torch.sin(25 * along + phase) * sideways


def main() -> None:
    """Print one JSON object."""
    generator = torch.Generator().manual_seed(0)
    truth = groom(TRUE_STRANDS, generator)
    chosen = truth[::4]
    drift = torch.randn(len(chosen), 1, 3, generator=generator) * 1e-3
    start = time.perf_counter()
    cpu_start = time.process_time()
    true_points: OrientedPoints = sample_strands(truth)
    predicted: OrientedPoints = sample_strands(chosen + drift)
    scores = score_geometry(predicted, true_points)
    figures = {
        "true_points": len(true_points),
        "predicted_points": len(predicted),
        "seconds": round(time.perf_counter() - start, 1),
        "cpu_seconds": round(time.process_time() - cpu_start, 1),
        "threads": torch.get_num_threads(),
        "peak_gigabytes": round(peak_memory() / 1e9, 2),
        "f_scores": {score.threshold.name: round(score.unsigned.f_score, 2) for score in scores},
        "consistency": {score.threshold.name: round(score.strand_consistency or 0.0, 2) for score in scores},
    }
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main()
