"""Compare strands, of this program or any other, with true strands.

python examples/04_score_strands.py RUN/groom.usd CAPTURE
"""

from pathlib import Path

import tyro

import neural_strands as ns


def main(predicted: Path, truth: Path, /) -> None:
    """Print precision, recall, F and strand consistency in percent.

    Args:
        predicted: groom or line segments, metres.
        truth: groom, or folder of a capture with ground_truth.npz.
    """
    print(f"{'threshold':>10} {'precision':>9} {'recall':>7} {'F':>7} {'consistency':>11}")
    for name, score in ns.score(predicted, truth).items():
        found = score.unsigned
        consistency = score.strand_consistency or 0.0
        print(f"{name:>10} {found.precision:9.2f} {found.recall:7.2f} {found.f_score:7.2f} {consistency:11.2f}")


if __name__ == "__main__":
    tyro.cli(main)
