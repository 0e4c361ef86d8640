"""Reads a USD stage in a separate process: `python -m neural_strands.grooms.usd_worker STAGE ARRAYS`.

USD's library can crash on damaged binary files, prints to standard error, and trusts sizes claimed by files. Here a
crash ends only this process, messages are dropped, and memory is bounded. On success the arrays of a groom are written
as an .npz file and the exit status is 0. A rejected stage gives one JSON list on standard output (where, expected,
found, advice) and exit status 3. Imports stay light (no torch), so that the process starts quickly.
"""

import importlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from neural_strands.grooms.usd_curves import Curves, StageError, sampled

REFUSED = 3
"""Exit status for a stage that was rejected with a reason."""
BASE_MEMORY = 2**30
"""Memory allowed for any stage, bytes."""
MEMORY_PER_BYTE = 64
"""Additional memory allowed per byte of the file, bytes."""
PRIMVARS: dict[str, tuple[str, tuple[int, ...]]] = {
    "root_uv": ("st", (2,)),
    "root_normal": ("rootNormal", (3,)),
    "color": ("displayColor", (3,)),
    "unseen": ("unseen", ()),
}
"""Attributes of a strand, their primvars, and the shape of one value."""


def main(source: Path, target: Path) -> int:
    """Read `source`, write `target`, return the exit status."""
    _bound_memory(BASE_MEMORY + MEMORY_PER_BYTE * source.stat().st_size)
    try:
        arrays = read_stage(source)
    except StageError as error:
        sys.stdout.write(json.dumps(error.args))
        return REFUSED
    with target.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    return 0


def read_stage(path: Path) -> dict[str, np.ndarray]:
    """Return `points`, `sizes` and the attributes that all curve prims have, in metres, y up.

    Raises:
        StageError: it is not a stage, has no curves, or its arrays disagree.
    """
    tf, usd, geometry = (pxr_module(name) for name in ("Tf", "Usd", "UsdGeom"))
    try:
        stage = usd.Stage.Open(str(path), load=usd.Stage.LoadAll)
        scale, up = geometry.GetStageMetersPerUnit(stage), str(geometry.GetStageUpAxis(stage))
        if not 1e-9 < scale < 1e9:
            raise StageError("byte 0 (metersPerUnit)", "a positive number", f"{scale:g}")
        found = [prim for prim in stage.Traverse() if prim.IsA(geometry.BasisCurves)]
        # Guides represent strands that are in the stage as well; a stage with only guides is read as it is.
        strands = [prim for prim in found if geometry.Imageable(prim).ComputePurpose() != geometry.Tokens.guide]
        parts = [_curves(prim, scale, up) for prim in strands or found]
    except (tf.ErrorException, UnicodeDecodeError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split(" : ")[-1].split())[:200]
        raise StageError("byte 0", "a USD stage", f"one that cannot be read ({reason})") from error
    if not parts:
        raise StageError("byte 0 (stage)", "BasisCurves", "none", "export hair as curves")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "sizes")}
    for name in ("width", *PRIMVARS):
        values = [part.attributes[name] for part in parts if name in part.attributes]
        if len(values) == len(parts):
            arrays[name] = np.concatenate(values)
    return arrays


def pxr_module(name: str) -> Any:
    """Import a module of USD, as Any because its type stubs are incomplete."""
    return importlib.import_module(f"pxr.{name}")


def _curves(prim: Any, scale: float, up: str) -> Curves:
    """Read one prim into metres, y up.

    Raises:
        StageError: its arrays disagree, or it is closed.
    """
    usd, geometry = pxr_module("Usd"), pxr_module("UsdGeom")
    curves = geometry.BasisCurves(prim)
    place = f"byte 0 (prim {curves.GetPath()})"
    time = usd.TimeCode.EarliestTime()
    wrap, kind = str(curves.GetWrapAttr().Get()), str(curves.GetTypeAttr().Get())
    basis = "linear" if kind == "linear" else str(curves.GetBasisAttr().Get())
    points = np.array(curves.GetPointsAttr().Get(time) or [], dtype=np.float64).reshape(-1, 3)
    sizes = np.array(curves.GetCurveVertexCountsAttr().Get(time) or [], dtype=np.int64)
    if wrap == "periodic":
        raise StageError(place, "open curves", "periodic ones", "export strands with a root and a tip")
    if (sizes < 0).any() or int(sizes.sum()) != len(points):
        raise StageError(place, f"curveVertexCounts that add up to {len(points)} points", str(int(sizes.sum())))
    attributes: dict[str, np.ndarray] = {}
    widths = np.array(curves.GetWidthsAttr().Get(time) or [], dtype=np.float64)
    if len(widths) in (1, len(sizes)) and len(widths) != len(points):
        widths = np.repeat(widths, sizes) if len(widths) == len(sizes) else np.full(len(points), widths[0])
    if len(widths):
        attributes["width"] = widths
    primvars = geometry.PrimvarsAPI(prim)
    for name, (primvar, shape) in PRIMVARS.items():
        found = primvars.GetPrimvar(primvar)
        values = found.ComputeFlattened(time) if found and found.HasValue() else None
        if values is not None and np.shape(values) == (len(sizes), *shape):
            attributes[name] = np.array(values, dtype=np.float64)
    read = sampled(place, Curves(points, sizes, attributes), basis, pinned=wrap == "pinned")
    matrix = np.array(geometry.Xformable(prim).ComputeLocalToWorldTransform(time))
    # USD's matrices act on row vectors. Blender's z up has its front along -y.
    turn = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]) if up == "Z" else np.eye(3)
    moved = dict(read.attributes)
    if "root_normal" in moved and not np.array_equal(matrix, np.eye(4)):
        normal = moved["root_normal"] @ np.linalg.pinv(matrix[:3, :3]).T
        moved["root_normal"] = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    if "root_normal" in moved:
        moved["root_normal"] = moved["root_normal"] @ turn
    if "width" in moved:
        moved["width"] = moved["width"] * (scale * np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    return Curves((read.points @ matrix[:3, :3] + matrix[3, :3]) @ turn * scale, read.sizes, moved)


def _bound_memory(limit: int) -> None:
    """Make allocations beyond `limit` bytes fail, if the system supports it."""
    try:
        resource = importlib.import_module("resource")
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        if hard != resource.RLIM_INFINITY:
            limit = min(limit, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    except (ImportError, OSError, ValueError):
        return


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
