"""Read a groom of any format, say what it holds, and write it with evenly spaced points in other formats.

python examples/01_groom_formats.py hair.usd 64 hair.ply hair.npz
"""

from pathlib import Path

import tyro

import neural_strands as ns


def main(groom: Path, points: int, /, *outputs: Path) -> None:
    """Convert a groom.

    Args:
        groom: .hair, .data, .tfx, .usd, .ply, .obj or .npz.
        points: points of every strand in the output, evenly spaced along it.
        outputs: files to write; the suffix chooses the format.
    """
    found = ns.read_groom(groom)
    lengths = found.lengths()
    print(f"{len(found)} strands of {int(found.sizes.min())} to {int(found.sizes.max())} points")
    print(f"lengths from {lengths.min():.3f} to {lengths.max():.3f}, median {lengths.median():.3f}")
    strands = found.strands(points)
    for path in outputs:
        ns.write_groom(path, strands)
        print(f"{path}: {len(strands)} strands of {strands.points_per_strand} points")


if __name__ == "__main__":
    tyro.cli(main)
