"""`.data` files (USC-HairSalon): int32 strands, then for each strand int32 points and that many float32 triples.

Stored: points, as float32, and nothing else.
"""

from pathlib import Path

import numpy as np

from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse, require_bytes
from neural_strands.grooms.groom import Groom


def read_data(path: Path) -> Groom:
    """Read a `.data` file.

    Raises:
        InputError: the file's contents contradict its counts.
    """
    data = read_groom_bytes(path)
    require_bytes(path, 0, 4, len(data), "strand count")
    strands = int.from_bytes(data[:4], "little", signed=True)
    if strands < 0:
        raise refuse(path, "byte 0", "a strand count", str(strands), "choose a .data file of hair")
    require_bytes(path, 4, 4 * strands, len(data), f"counts for {strands} strands")
    sizes, end = np.zeros(strands, dtype=np.int64), 4
    for strand in range(strands):
        require_bytes(path, end, 4, len(data), f"the count of strand {strand} of {strands}")
        points = int.from_bytes(data[end : end + 4], "little", signed=True)
        if points < 0:
            raise refuse(path, f"byte {end}", f"the number of points of strand {strand}", str(points))
        require_bytes(path, end + 4, 12 * points, len(data), f"{points} points of strand {strand}")
        sizes[strand] = points
        end += 4 + 12 * points
    if end != len(data):
        raise refuse(
            path, f"byte {end}", f"the end of the file after {strands} strands", f"{len(data) - end} bytes more"
        )
    words = np.frombuffer(data, "<u4", len(data) // 4)
    # Before strand s there are s + 2 counts, and three words for each earlier point.
    starts = np.concatenate([[0], np.cumsum(sizes)])
    is_number = np.ones(len(words), dtype=bool)
    is_number[0] = False
    is_number[1 + np.arange(strands) + 3 * starts[:-1]] = False
    vertices = words[is_number].view("<f4").reshape(-1, 3)

    def locate(_: str, row: int) -> str:
        """Describe the byte of a vertex."""
        strand = int(np.searchsorted(starts[1:], row, side="right")) if row < starts[-1] else strands - 1
        return f"byte {4 * (2 + strand) + 12 * row}"

    return build_groom(path, vertices, sizes, locate, {})


def write_data(path: Path, groom: Groom) -> None:
    """Write a `.data` file."""
    sizes, offsets = groom.sizes.cpu().numpy(), groom.offsets.cpu().numpy()
    words = np.zeros(1 + len(groom) + 3 * len(groom.vertices), dtype="<u4")
    words[0] = len(groom)
    counts = 1 + np.arange(len(groom)) + 3 * offsets[:-1]
    words[counts] = sizes
    is_number = np.ones(len(words), dtype=bool)
    is_number[0] = False
    is_number[counts] = False
    words[is_number] = groom.vertices.cpu().numpy().astype("<f4").reshape(-1).view("<u4")
    path.write_bytes(words.tobytes())
