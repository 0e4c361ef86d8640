"""From a capture to strands: line segments by multi-view stereo, then the fit.

python examples/02_capture_to_groom.py CAPTURE RUN --preset demo --alpha 0.3
"""

from dataclasses import replace
from pathlib import Path

import tyro

import neural_strands as ns


def main(capture: Path, run: Path, /, preset: str = "demo", steps: int | None = None, alpha: float = 0.5) -> None:
    """Fit a capture.

    Args:
        capture: folder with photographs, cameras and a head.
        run: folder of the results.
        preset: demo, fast or paper.
        steps: optimisation steps, instead of the preset's.
        alpha: weight of the opacity loss.
    """
    config = ns.preset(preset)
    config = replace(config, steps=steps or config.steps, weights=replace(config.weights, alpha=alpha))
    # A fit makes its own segments; made before, they can be looked at and used by several fits.
    path = run.with_name(f"{run.name}_segments.npz")
    segments = ns.make_segments(ns.load_capture(capture), path, config)
    print(f"{path}: {segments.segment_count} segments, {len(segments)} points")
    results = ns.fit(capture, run, config, segments=path)
    print(f"{results.groom}: {len(ns.read_groom(results.groom))} strands")


if __name__ == "__main__":
    tyro.cli(main)
