"""Nearest neighbours within a radius: 300,000 queries against 500,000 points of a groom.

    python benchmarks/speed/nearest.py

Times the building of the grid and the search, on 2 CPU threads and, if available, on CUDA; and, in processor time and
in turn with ours on the CPU, SciPy's k-d tree.
"""

import json
import sys

import torch
from beside import beside
from scipy.spatial import KDTree
from score import groom

from neural_strands.evaluation.timing import time_function
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import nearest

RADII = (0.002, 0.005, 0.01)
"""Metres."""


def peer(points: torch.Tensor, queries: torch.Tensor, radius: float) -> dict[str, float]:
    """Processor milliseconds of ours and of SciPy's k-d tree, of building and searching."""
    tree, grid, wanted = KDTree(points.numpy()), PointGrid.build(points, radius), queries.numpy()
    build = ("k-d tree", lambda: KDTree(points.numpy()))
    search = ("k-d tree", lambda: tree.query(wanted, distance_upper_bound=radius))
    rows = [
        beside("build", lambda: PointGrid.build(points, radius), build, runs=2),
        beside("search", lambda: nearest(queries, grid, radius), search, runs=2),
    ]
    pairs = ((f"{row.what}_cpu_ms", row.ours, row.theirs or 0.0) for row in rows)
    return {name: round(ms, 1) for key, ours, tree in pairs for name, ms in ((key, ours), (f"kd_tree_{key}", tree))}


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
            figures = {
                "device": device,
                "threads": torch.get_num_threads(),
                "radius_mm": 1e3 * radius,
                "found_percent": round(100 * float((nearest(there, grid, radius)[1] >= 0).float().mean()), 1),
                "build_ms": round(1e3 * build.fastest, 1),
                "search_ms": round(1e3 * search.fastest, 1),
                **(peer(here, there, radius) if device == "cpu" else {}),
            }
            sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main()
