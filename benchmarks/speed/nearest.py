"""Nearest neighbours within a radius: 300,000 queries against 500,000 points of a groom.

    python benchmarks/speed/nearest.py

Times the building of the grid and the search, on 2 CPU threads and, if available, on CUDA.
"""

import json
import sys
import time

import torch
from score import groom

from neural_strands.evaluation.timing import time_function
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import nearest

RADII = (0.002, 0.005, 0.01)
"""Metres."""


def main() -> None:
    """Print one JSON object per device and radius."""
    generator = torch.Generator().manual_seed(0)
    truth = groom(8000, generator)
    points, queries = truth[:5000].reshape(-1, 3), truth[5000:].reshape(-1, 3)
    for device in ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",):
        here, there = points.to(device), queries.to(device)
        for radius in RADII:
            grid = PointGrid.build(here, radius)
            build = time_function(lambda: PointGrid.build(here, radius), device)  # noqa: B023
            search = time_function(lambda: nearest(there, grid, radius), device)  # noqa: B023
            cpu_start = time.process_time()
            nearest(there, grid, radius)
            cpu = time.process_time() - cpu_start
            figures = {
                "device": device,
                "threads": torch.get_num_threads(),
                "radius_mm": 1e3 * radius,
                "found_percent": round(100 * float((nearest(there, grid, radius)[1] >= 0).float().mean()), 1),
                "build_ms": round(1e3 * build.fastest, 1),
                "search_ms": round(1e3 * search.fastest, 1),
                "search_cpu_ms": round(1e3 * cpu, 1),
            }
            sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main()
