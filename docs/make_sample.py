"""Make the demo's photographs anew.

Needed after a change of the mannequin, the straight style or the path tracer:

    neural-strands demo OUT --render
    python docs/make_sample.py OUT/capture
"""

import sys
from pathlib import Path

from neural_strands.capture.capture import Capture
from neural_strands.synthesis.sample import SAMPLE, pack_sample


def main(folder: Path) -> None:
    """Pack the capture into the package's own folder."""
    capture = Capture.load(folder)
    if capture.ground_truth is None:
        sys.exit(f"{folder}: expected a capture with true strands, found none; make one with `demo OUT --render`.")
    pack_sample(folder, capture.cameras, capture.ground_truth.points, SAMPLE)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
