"""`.ply` files: vertices and edges, as Blender, MeshLab and trimesh read them; binary, or text for reading only.

Stored, as float32: points; widths (a property of the vertices); and, in an element `strand` of our own, which other
programs skip, root uv, root normal, colour and the unseen share. Consecutive edges are joined into strands.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import excerpt
from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse, require_bytes
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.polylines import join_chains
from neural_strands.grooms.text import Lines

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
"""Scalar types of PLY, with numpy's names."""
STRAND_PROPERTIES = {
    "root_uv": ("u", "v"),
    "root_normal": ("nx", "ny", "nz"),
    "color": ("red", "green", "blue"),
    "unseen": ("unseen",),
}
"""Attributes of a strand, and the properties that store them."""
ELEMENT = re.compile(r"element ([!-~]{1,80}) (\d{1,18})")
PROPERTY = re.compile(r"property (\S+) ([!-~]{1,80})")
LONGEST_HEADER = 65536


@dataclass(frozen=True)
class Element:
    """One table of a file.

    Attributes:
        name: vertex, edge, strand, or one that is skipped.
        count: number of rows according to the header.
        properties: names and numpy types of the columns; None if it contains lists.
    """

    name: str
    count: int
    properties: tuple[tuple[str, str], ...] | None


def read_ply(path: Path) -> Groom:
    """Read a `.ply` file of vertices and edges.

    Raises:
        InputError: the file's contents contradict its header, or it has no edges.
    """
    data = read_groom_bytes(path)
    encoding, elements, body = _header(path, data)
    tables, starts = _tables(path, data, encoding, elements, body)
    for name, columns in (("vertex", ("x", "y", "z")), ("edge", ("vertex1", "vertex2"))):
        if name not in tables or not set(columns) <= set(tables[name].dtype.names or ()):
            expected = f"an element {name} with {', '.join(columns)}"
            raise refuse(
                path,
                "byte 0",
                expected,
                excerpt(", ".join(tables)) if tables else "none",
                "export polylines, not points",
            )
    vertex, edge = tables["vertex"], tables["edge"]
    ends = np.stack([edge["vertex1"], edge["vertex2"]], axis=1).astype(np.float64)
    wrong = ~((ends >= 0) & (ends < len(vertex)) & (ends == np.floor(ends))).all(axis=1)
    if wrong.any():
        first = int(wrong.argmax())
        expected = f"vertices from 0 to {len(vertex) - 1}"
        raise refuse(path, starts["edge"](first), expected, f"{ends[first, 0]:g} and {ends[first, 1]:g}")
    if len(ends) == 0:
        raise refuse(path, f"byte {body}", "at least one edge", "none", "export polylines, not points")
    order, sizes = join_chains(ends.astype(np.int64).reshape(-1), np.full(len(ends), 2))
    attributes: dict[str, np.ndarray] = {}
    if "width" in (vertex.dtype.names or ()):
        attributes["width"] = vertex["width"][order]
    if "strand" in tables:
        attributes |= _strand_attributes(path, tables["strand"], len(sizes), starts["strand"](0))

    def locate(name: str, row: int) -> str:
        """Describe the place of a vertex or of a row of the element `strand`."""
        return starts["vertex"](int(order[row])) if name in ("vertices", "width") else starts["strand"](row)

    positions = np.stack([vertex[axis] for axis in "xyz"], axis=1)[order]
    return build_groom(path, positions, sizes, locate, attributes)


def write_ply(path: Path, groom: Groom) -> None:
    """Write a binary little-endian `.ply` file."""
    vertices = groom.vertices.cpu().float().numpy()
    offsets = groom.offsets.cpu().numpy()
    columns = list(vertices.T) + ([] if groom.width is None else [groom.width.cpu().numpy()])
    names = ["x", "y", "z", "width"][: len(columns)]
    first = np.delete(np.arange(len(vertices)), offsets[1:] - 1)
    lines = ["ply", "format binary_little_endian 1.0", "comment neural-strands: edges run from root to tip"]
    lines += [f"element vertex {len(vertices)}", *(f"property float {name}" for name in names)]
    lines += [f"element edge {len(first)}", "property int vertex1", "property int vertex2"]
    present = [name for name in STRAND_PROPERTIES if getattr(groom, name) is not None]
    if present:
        lines.append(f"element strand {len(groom)}")
        lines += [f"property float {column}" for name in present for column in STRAND_PROPERTIES[name]]
    with path.open("wb") as file:
        file.write(("\n".join([*lines, "end_header"]) + "\n").encode())
        file.write(np.stack(columns, axis=1).astype("<f4").tobytes())
        file.write(np.stack([first, first + 1], axis=1).astype("<i4").tobytes())
        if present:
            values = [getattr(groom, name).cpu().numpy().reshape(len(groom), -1) for name in present]
            table = np.concatenate(values, axis=1)
            file.write(table.astype("<f4").tobytes())


def _header(path: Path, data: bytes) -> tuple[str, list[Element], int]:
    """Return the encoding, the elements, and the byte where the body starts."""
    match = re.search(rb"(?:^|\n)end_header[ \t]*\r?\n", data[:LONGEST_HEADER])
    if not data.startswith(b"ply") or match is None:
        raise refuse(path, "line 1 (byte 0)", "a ply header", excerpt(data[:12]), "choose a .ply file")
    encoding, elements = "", []
    for number, line in enumerate(data[: match.start()].decode("latin1").splitlines(), start=1):
        words = line.split()
        text = " ".join(words)
        if words[:1] == ["format"] and len(words) > 1:
            encoding = words[1]
        elif found := ELEMENT.fullmatch(text):
            elements.append(Element(found[1], int(found[2]), ()))
        elif words[:1] in (["property"], ["element"]):
            place = f"line {number} (in a header of {match.end()} bytes, from byte 0)"
            found = PROPERTY.fullmatch(text)
            scalar = found is not None and found[1] in TYPES
            if not elements or (words[1:2] != ["list"] and not scalar):
                raise refuse(path, place, "property TYPE NAME after an element", excerpt(text))
            last = elements.pop()
            known = last.properties if scalar else None
            added = None if known is None or found is None else (*known, (found[2], TYPES[found[1]]))
            elements.append(Element(last.name, last.count, added))
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise refuse(
            path, "line 2 (byte 4)", "format ascii, binary_little_endian or binary_big_endian", excerpt(encoding)
        )
    return encoding, elements, match.end()


def _tables(
    path: Path, data: bytes, encoding: str, elements: list[Element], body: int
) -> tuple[dict[str, np.ndarray], dict[str, Callable[[int], str]]]:
    """Return the tables of numbers as structured arrays, each with a function that locates a row in the file."""
    if encoding == "ascii":
        return _text_tables(path, data, elements, body)
    order = "<" if encoding == "binary_little_endian" else ">"
    tables, starts, end = {}, {}, body
    for element in elements:
        if element.properties is None:
            break
        dtype = _dtype(path, element, order)
        require_bytes(path, end, dtype.itemsize * element.count, len(data), f"{element.count} rows of {element.name}")
        if dtype.itemsize:
            tables[element.name] = np.frombuffer(data, dtype, element.count, end)
            starts[element.name] = lambda row, start=end, size=dtype.itemsize: f"byte {start + size * row}"
        end += dtype.itemsize * element.count
    return tables, starts


def _text_tables(
    path: Path, data: bytes, elements: list[Element], body: int
) -> tuple[dict[str, np.ndarray], dict[str, Callable[[int], str]]]:
    """Like `_tables`, for `format ascii`: one row per line."""
    lines = Lines(path, data)
    filled = np.flatnonzero((lines.word_count > 0) & (lines.start >= body))
    tables, starts, end = {}, {}, 0
    for element in elements:
        rows = filled[end : end + element.count]
        if len(rows) < element.count:
            where = lines.where(len(lines) - 1)
            raise refuse(path, where, f"{element.count} rows of {element.name}", f"{len(rows)} before the end")
        end += element.count
        if not element.properties:
            continue
        chosen = np.zeros(len(lines), dtype=bool)
        chosen[rows] = True
        values, counts = lines.numbers(chosen)
        if (wrong := counts != len(element.properties)).any():
            first = int(wrong.argmax())
            expected = f"{len(element.properties)} values of {element.name}"
            raise refuse(path, lines.where(int(rows[first])), expected, str(counts[first]))
        dtype = np.dtype([(name, "f8") for name in _dtype(path, element, "<").names or ()])
        tables[element.name] = values.view(dtype)
        starts[element.name] = lambda row, rows=rows: lines.where(int(rows[row]) if row < len(rows) else 0)
    return tables, starts


def _dtype(path: Path, element: Element, order: str) -> np.dtype:
    """The row type of a table, packed."""
    names = [name for name, _ in element.properties or ()]
    if len(set(names)) < len(names):
        raise refuse(path, "byte 0", f"properties of {element.name} that differ", excerpt(", ".join(names)))
    return np.dtype([(name, order + kind) for name, kind in element.properties or ()])


def _strand_attributes(path: Path, table: np.ndarray, strands: int, where: str) -> dict[str, np.ndarray]:
    """Attributes of the element `strand`."""
    if len(table) != strands:
        raise refuse(path, where, f"{strands} rows of strand, as the edges make", str(len(table)))
    names = set(table.dtype.names or ())
    return {
        name: table[columns[0]] if len(columns) == 1 else np.stack([table[column] for column in columns], axis=1)
        for name, columns in STRAND_PROPERTIES.items()
        if set(columns) <= names
    }
