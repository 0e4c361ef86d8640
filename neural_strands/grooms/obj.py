"""`.obj` files: one polyline (`l`) per strand, root first; written by Maya, Houdini, XGen and research code.

Stored: points, in text that restores every float32 exactly, and nothing else. Lines that continue from the last point
of the previous line (`l 1 2`, `l 2 3`, as Blender writes loose edges) are joined into one strand.
"""

import itertools
import re
from pathlib import Path

import numpy as np

from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.polylines import join_chains
from neural_strands.grooms.text import Lines

TEXTURE_INDEX = re.compile(rb"/\d*")


def read_obj(path: Path) -> Groom:
    """Read the polylines of an `.obj` file.

    Raises:
        InputError: it contains no polylines, or they refer to vertices that do not exist.
    """
    data = read_groom_bytes(path)
    if b"\\\n" in data:
        # A backslash continues a line; two spaces in its place leave all byte positions unchanged.
        data = data.replace(b"\\\n", b"  ")
    lines = Lines(path, data)
    is_vertex, is_line = lines.keyword(b"v"), lines.keyword(b"l")
    if not is_line.any():
        found = "a mesh" if lines.keyword(b"f").any() else f"{int(is_vertex.sum())} points"
        where = f"line {len(lines)} (byte {len(data)})"
        raise refuse(path, where, "polylines (lines that begin with l)", f"{found} only", "export curves, not a mesh")
    numbers, counts = lines.numbers(is_vertex, skip_word=True)
    vertex_line = np.flatnonzero(is_vertex)
    if len(counts) and counts.min() < 3:
        line = int(vertex_line[int((counts < 3).argmax())])
        raise refuse(path, lines.where(line), "three coordinates", str(int(counts[counts < 3][0])))
    starts = np.cumsum(counts) - counts
    positions = numbers[starts[:, None] + np.arange(3)]
    if b"/" in data:
        cleaned = TEXTURE_INDEX.sub(lambda match: b" " * len(match[0]), data)
        lines = Lines(path, cleaned)
    raw, counts = lines.numbers(is_line, skip_word=True)
    element_line = np.flatnonzero(is_line)
    if counts.min() < 2:
        line = int(element_line[int((counts < 2).argmax())])
        raise refuse(path, lines.where(line), "at least two points per strand", str(int(counts.min())))
    line_of = np.repeat(element_line, counts)
    defined = np.searchsorted(vertex_line, line_of)
    # Indices count from 1; a negative one counts back from the vertices defined before its line.
    with np.errstate(invalid="ignore"):
        index = np.where(raw < 0, raw + defined, raw - 1)
        wrong = ~((index >= 0) & (index < len(positions)) & (index == np.floor(index)))
    if wrong.any():
        first = int(wrong.argmax())
        expected = f"a vertex from 1 to {len(positions)}"
        raise refuse(path, lines.where(int(line_of[first])), expected, f"{raw[first]:g}")
    order, sizes = join_chains(index.astype(np.int64), counts)

    def locate(_: str, row: int) -> str:
        """Describe the line of a vertex."""
        return lines.where(int(vertex_line[order[row]]))

    return build_groom(path, positions[order].astype(np.float32), sizes, locate, {})


def write_obj(path: Path, groom: Groom) -> None:
    """Write one `v` line per point and one `l` line per strand."""
    points = groom.vertices.cpu().float().numpy()
    text = "v %.9g %.9g %.9g\n" * len(points) % tuple(points.reshape(-1).tolist())
    offsets = groom.offsets.cpu().tolist()
    rows = ["l " + " ".join(map(str, range(a + 1, b + 1))) for a, b in itertools.pairwise(offsets)]
    path.write_text("# neural-strands: one polyline a strand, root first\n" + text + "\n".join(rows) + "\n")
