"""`.tfx` files of TressFX 2: text; for each strand its number of points and root uv, then one point per line.

Stored: points and root uv, in text that restores every float32 exactly, and nothing else. Strands may differ in their
number of points. A header that scales, rotates or moves the hair is rejected, because programs disagree on the order.
"""

import re
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import InputError, excerpt
from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.text import Lines

STRAND = re.compile(
    rb"\s*strand\s+\d{1,18}\s+numVerts\s+(\d{1,18})(?:\s+texcoord\s+([0-9.eE+-]{1,40})\s+([0-9.eE+-]{1,40}))?\s*",
    re.IGNORECASE,
)
IDENTITY = {b"scale": (1.0,), b"rotation": (0.0, 0.0, 0.0), b"translation": (0.0, 0.0, 0.0)}


def read_tfx_text(path: Path) -> Groom:
    """Read a text `.tfx` file, version 2.

    Raises:
        InputError: the file's contents contradict its header.
    """
    data = read_groom_bytes(path).replace(b",", b" ")
    lines = Lines(path, data)
    filled = np.flatnonzero(lines.word_count > 0)
    is_strand = np.zeros(len(lines), dtype=bool)
    begin = lines.word[lines.first_word[filled]]
    is_strand[filled] = (lines.buffer[begin] | 32) == ord("s")
    is_strand[filled[np.isin(lines.word_count[filled], (1, 2, 3))]] = False
    strand_line = np.flatnonzero(is_strand)
    claimed = _header(lines, filled, int(strand_line[0]) if len(strand_line) else len(lines))
    if claimed is not None and claimed[0] != len(strand_line):
        raise refuse(path, lines.where(claimed[1]), f"{claimed[0]} strands as numStrands says", str(len(strand_line)))
    sizes, uv = np.zeros(len(strand_line), dtype=np.int64), np.full((len(strand_line), 2), np.nan)
    bounds = np.append(lines.start, len(data))
    for row, line in enumerate(strand_line):
        match = STRAND.fullmatch(data[bounds[line] : bounds[line + 1]])
        if match is None:
            raise refuse(path, lines.where(int(line)), "strand I numVerts N texcoord U V", "something else")
        sizes[row] = int(match[1])
        if match[2] is not None:
            uv[row] = _pair(lines, int(line), match)
    is_point = np.zeros(len(lines), dtype=bool)
    is_point[filled] = True
    is_point[: strand_line[0] if len(strand_line) else len(lines)] = False
    is_point[strand_line] = False
    point_line = np.flatnonzero(is_point)
    _check_counts(lines, strand_line, point_line, sizes)
    values, counts = lines.numbers(is_point)
    if (counts != 3).any():
        bad = int((counts != 3).argmax())
        raise refuse(path, lines.where(int(point_line[bad])), "three coordinates", f"{counts[bad]} words")

    def locate(name: str, row: int) -> str:
        """Describe the line of a point, or of the first line of a strand."""
        chosen = point_line if name == "vertices" else strand_line
        return lines.where(int(chosen[row]) if row < len(chosen) else len(lines) - 1)

    has_uv = len(uv) > 0 and bool(np.isfinite(uv).all())
    vertices = values.reshape(-1, 3).astype(np.float32)
    return build_groom(path, vertices, sizes, locate, {"root_uv": uv if has_uv else None})


def write_tfx_text(path: Path, groom: Groom) -> None:
    """Write a text `.tfx` file, version 2."""
    sizes, offsets = groom.sizes.cpu().tolist(), groom.offsets.cpu().tolist()
    points = groom.vertices.cpu().float().numpy()
    uv = None if groom.root_uv is None else groom.root_uv.cpu().float().tolist()
    text = [
        "version 2.0\nscale 1.0\nrotation 0.0 0.0 0.0\ntranslation 0.0 0.0 0.0\nbothEndsImmovable 0\n",
        f"maxNumVerticesInStrand {max(sizes)}\nnumFollowHairsPerGuideHair 0\nmaxRadiusAroundGuideHair 0.0\n",
        f"numStrands {len(groom)}\nis sorted 1\n",
    ]
    for strand, size in enumerate(sizes):
        texcoord = "" if uv is None else f" texcoord {uv[strand][0]:.9g} {uv[strand][1]:.9g}"
        text.append(f"strand {strand} numVerts {size}{texcoord}\n")
        text.append("%.9g %.9g %.9g\n" * size % tuple(points[offsets[strand] : offsets[strand + 1]].ravel().tolist()))
    path.write_text("".join(text))


def _header(lines: Lines, filled: np.ndarray, end: int) -> tuple[int, int] | None:
    """Read the lines before the first strand: the claimed number of strands and its line, if present."""
    claimed = None
    for line in filled[filled < end][:64]:
        begin = int(lines.start[line])
        words = lines.data[begin : begin + 200].split(b"\n", 1)[0].split()
        if words[0] == b"numStrands":
            if len(words) != 2 or not words[1].isdigit() or len(words[1]) > 18:
                raise refuse(lines.path, lines.where(int(line)), "a number of strands", excerpt(words[1:]))
            claimed = int(words[1]), int(line)
        if words[0] in IDENTITY and tuple(map(_number, words[1:])) != IDENTITY[words[0]]:
            name = words[0].decode()
            advice = "export without a transform"
            raise refuse(
                lines.path, lines.where(int(line)), f"a {name} that changes nothing", excerpt(words[1:]), advice
            )
    return claimed


def _number(word: bytes) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _pair(lines: Lines, line: int, match: re.Match[bytes]) -> tuple[float, float]:
    u, v = _number(match[2]), _number(match[3])
    if u is None or v is None:
        raise refuse(
            lines.path, lines.where(line), "a texcoord of two numbers", excerpt(match[0].decode("latin1").strip())
        )
    return u, v


def _check_counts(lines: Lines, strand_line: np.ndarray, point_line: np.ndarray, sizes: np.ndarray) -> None:
    """Reject strands whose number of lines differs from the number they claim.

    Raises:
        InputError: there is such a strand; the message names its line.
    """
    found = np.diff(np.append(np.searchsorted(point_line, strand_line), len(point_line)))
    if (wrong := found != sizes).any():
        strand = int(wrong.argmax())
        where = lines.where(int(strand_line[strand]))
        raise refuse(lines.path, where, f"{sizes[strand]} lines of points after it", f"{found[strand]}")


def is_tfx_text(path: Path) -> bool:
    """Whether a `.tfx` file is text, that is, begins with the word "version".

    Raises:
        InputError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(64).lstrip().lower().startswith(b"version")
    except OSError as error:
        raise InputError(
            f"{path}: expected a groom file, but it cannot be read ({error.strerror or error})."
        ) from error
