"""torch.compile sees a static frame and decoding as one graph each, launches of kernels included."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[1] / "support" / "compiled_frame.py"


@pytest.mark.slow(seconds=60)
def test_a_frame_and_decoding_are_one_graph_each():
    done = subprocess.run([sys.executable, str(PROGRAM)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["graphs"] == found["decode_graphs"] == 1
    assert found["decoded"]
    assert found["frame"]["same"] < 1e-6
    # The graph is of the work and not of its results: other strands give another picture.
    assert found["frame"]["moved"] < 1e-6
    assert found["frame"]["between"] > 0.02
    expected = {"draw_triangles_in_lanes", "draw_listed", "count_parts", "gather_parts", "mark_nodes", "sample_kernel"}
    expected |= {"blend_nodes", "accumulate", "normalise", "count_openings", "mean_colour"}
    assert expected <= set(found["kernels"])
