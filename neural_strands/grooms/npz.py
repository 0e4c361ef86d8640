"""`.npz` archives of numpy: arrays named like the fields of `Groom`; everything is stored exactly (float32, int64).

An archive may also contain `points` (strand, point, 3) in place of `vertices` and `offsets`.
"""

from pathlib import Path

import numpy as np

from neural_strands.foundation.npz import ArraySpec, array_names, read_npz
from neural_strands.grooms.checks import build_groom, refuse
from neural_strands.grooms.groom import ATTRIBUTES, OF_POINTS, Groom

RAGGED = (ArraySpec("vertices", "vertex 3", finite=False), ArraySpec("offsets", "strand+1", np.int64, kinds="iu"))
"""Strands of any number of points each."""
UNIFORM = (ArraySpec("points", "strand point 3", finite=False),)
"""Strands of the same number of points each."""
EXTRAS = (
    ArraySpec("root_uv", "strand 2", required=False, finite=False),
    ArraySpec("root_normal", "strand 3", required=False, finite=False),
    ArraySpec("width", "vertex", required=False, finite=False),
    ArraySpec("color", "strand 3", required=False, finite=False),
    ArraySpec("unseen", "strand", required=False, finite=False),
    ArraySpec("t", "vertex", required=False, finite=False),
)
"""Attributes; `build_groom` checks that they are finite, so that it can name the row."""


def read_groom_npz(path: Path) -> Groom:
    """Read an `.npz` archive.

    Raises:
        InputError: the file is not such an archive, lacks arrays, or arrays are longer than the file.
    """
    names = array_names(path)
    uniform = "points" in names and "vertices" not in names
    arrays = read_npz(path, "a groom", (*(UNIFORM if uniform else RAGGED), *EXTRAS))
    if uniform:
        points = arrays["points"]
        arrays["vertices"] = points.reshape(-1, 3)
        arrays["offsets"] = np.arange(len(points) + 1) * points.shape[1]
    vertices, offsets = arrays["vertices"], arrays["offsets"]
    if len(offsets) == 0 or offsets[0] != 0 or offsets[-1] != len(vertices) or (offsets[1:] < offsets[:-1]).any():
        expected = f"offsets that rise from 0 to {len(vertices)} vertices"
        raise refuse(path, "array offsets", expected, f"{len(offsets)} others")
    for name in OF_POINTS:
        if name in arrays and len(arrays[name]) != len(vertices):
            raise refuse(path, f"array {name}", f"{len(vertices)} rows, one for each point", str(len(arrays[name])))

    def locate(name: str, row: int) -> str:
        """Describe the row of an array; entries may be compressed, so no byte can be named."""
        return f"array {name}, row {row}"

    return build_groom(path, vertices, np.diff(offsets), locate, {name: arrays.get(name) for name in ATTRIBUTES})


def write_groom_npz(path: Path, groom: Groom) -> None:
    """Write an `.npz` archive, uncompressed."""
    fields = {name: getattr(groom, name) for name in ("vertices", "offsets", *ATTRIBUTES)}
    arrays = {name: value.cpu().numpy() for name, value in fields.items() if value is not None}
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
