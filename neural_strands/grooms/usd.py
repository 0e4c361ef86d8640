"""USD files (`.usd`, `.usdc` binary; `.usda` text): strands as one BasisCurves prim, as Blender and Houdini open it.

Kept, as float32: points, root uv (primvar `st`, a value a strand), root normals (primvar `rootNormal`), widths
(`widths`, a value a point) and colours (`displayColor`, a value a strand). Written linear, in metres, y up, rooted
at the first point. Read from every BasisCurves prim of the stage, linear or cubic (bezier, bspline, catmullRom:
sampled along the curve), through the transforms above it, metersPerUnit and upAxis, into metres, y up, +z front.
"""

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from neural_strands.grooms.checks import build_groom, read_bytes, refuse
from neural_strands.grooms.groom import ATTRIBUTES, Groom
from neural_strands.grooms.usd_curves import Curves, sampled

CRATE_HEADER = 24
"""Magic (8 bytes), version (8) and the offset of the table of contents (8) of a binary file."""


def read_usd(path: Path) -> Groom:
    """Read every curve of a USD stage.

    Raises:
        InputError: it is no stage, holds no curves, or its arrays disagree.
    """
    _check_container(path)
    tf, usd, geometry, utilities = (_pxr(name) for name in ("Tf", "Usd", "UsdGeom", "UsdUtils"))
    # While a delegate listens, the library prints nothing.
    listener = utilities.CoalescingDiagnosticDelegate()
    try:
        stage = usd.Stage.Open(str(path), load=usd.Stage.LoadAll)
        scale, up = geometry.GetStageMetersPerUnit(stage), str(geometry.GetStageUpAxis(stage))
        if not 0 < scale < 1e6:
            raise refuse(path, "byte 0 (metersPerUnit)", "a positive number", f"{scale:g}")
        parts = [_curves(path, prim, scale, up) for prim in stage.Traverse() if prim.IsA(geometry.BasisCurves)]
    except tf.ErrorException as error:
        reason = str(error).strip().splitlines()[-1].strip()[:200]
        raise refuse(path, "byte 0", "a USD stage", f"one that cannot be opened ({reason})") from error
    finally:
        listener.TakeUncoalescedDiagnostics()
    if not parts:
        raise refuse(path, "byte 0 (stage)", "BasisCurves", "none", "export hair as curves")
    joined = {}
    for name in ATTRIBUTES:
        values = [part.attributes.get(name) for part in parts]
        present = [value for value in values if value is not None]
        joined[name] = np.concatenate(present) if len(present) == len(parts) else None
    sizes = np.concatenate([part.sizes for part in parts])
    vertices = np.concatenate([part.points for part in parts])
    return build_groom(path, vertices, sizes, lambda name, row: f"byte 0 (curves, row {row} of {name})", joined)


def write_usd(path: Path, groom: Groom) -> None:
    """Write a stage with the curves `/hair/strands`; `.usda` is text, the others binary."""
    sdf, usd, geometry, arrays = (_pxr(name) for name in ("Sdf", "Usd", "UsdGeom", "Vt"))
    layer = sdf.Layer.CreateAnonymous(".usda" if path.suffix.lower() == ".usda" else ".usdc")
    stage = usd.Stage.Open(layer)
    geometry.SetStageMetersPerUnit(stage, 1.0)
    geometry.SetStageUpAxis(stage, geometry.Tokens.y)
    stage.SetDefaultPrim(geometry.Xform.Define(stage, "/hair").GetPrim())
    curves = geometry.BasisCurves.Define(stage, "/hair/strands")
    curves.CreateTypeAttr(geometry.Tokens.linear)
    curves.CreateWrapAttr(geometry.Tokens.nonperiodic)
    vertices = groom.vertices.cpu().float().numpy()
    curves.CreatePointsAttr(arrays.Vec3fArray.FromNumpy(vertices))
    curves.CreateCurveVertexCountsAttr(arrays.IntArray.FromNumpy(groom.sizes.cpu().numpy().astype(np.int32)))
    curves.CreateExtentAttr(arrays.Vec3fArray.FromNumpy(np.stack([vertices.min(axis=0), vertices.max(axis=0)])))
    if groom.width is not None:
        curves.CreateWidthsAttr(arrays.FloatArray.FromNumpy(groom.width.cpu().float().numpy()))
        curves.SetWidthsInterpolation(geometry.Tokens.vertex)
    primvars = geometry.PrimvarsAPI(curves)
    kinds = {
        "root_uv": ("st", sdf.ValueTypeNames.TexCoord2fArray, arrays.Vec2fArray),
        "root_normal": ("rootNormal", sdf.ValueTypeNames.Normal3fArray, arrays.Vec3fArray),
        "color": ("displayColor", sdf.ValueTypeNames.Color3fArray, arrays.Vec3fArray),
    }
    for name, (primvar, kind, array) in kinds.items():
        if (value := getattr(groom, name)) is not None:
            added = primvars.CreatePrimvar(primvar, kind, geometry.Tokens.uniform)
            added.Set(array.FromNumpy(np.ascontiguousarray(value.cpu().float().numpy())))
    layer.Export(str(path))


def _pxr(name: str) -> Any:
    """Import a module of USD where it is used; its stubs name nothing."""
    return importlib.import_module(f"pxr.{name}")


def _check_container(path: Path) -> None:
    """Refuse a file that is neither text nor a binary stage whose table of contents lies inside it.

    Raises:
        InputError: saying what is wrong.
    """
    data = read_bytes(path)
    if data.startswith(b"#usda") and path.suffix.lower() != ".usdc":
        return
    if not data.startswith(b"PXR-USDC"):
        raise refuse(path, "byte 0", "a USD stage (#usda or PXR-USDC)", repr(data[:8]), "choose a .usd file")
    contents = int.from_bytes(data[16:CRATE_HEADER], "little")
    if len(data) < CRATE_HEADER or not CRATE_HEADER <= contents < len(data) - 8:
        found = f"{contents} in a file of {len(data)} bytes"
        raise refuse(path, "byte 16", "the table of contents inside the file", found, "it is truncated")


def _curves(path: Path, prim: Any, scale: float, up: str) -> Curves:
    """Read one prim into metres, y up.

    Raises:
        InputError: its arrays disagree, or it is closed.
    """
    usd, geometry = _pxr("Usd"), _pxr("UsdGeom")
    curves = geometry.BasisCurves(prim)
    place = f"byte 0 (prim {curves.GetPath()})"
    time = usd.TimeCode.EarliestTime()
    wrap, kind = str(curves.GetWrapAttr().Get()), str(curves.GetTypeAttr().Get())
    basis = "linear" if kind == "linear" else str(curves.GetBasisAttr().Get())
    points = np.array(curves.GetPointsAttr().Get(time) or [], dtype=np.float64).reshape(-1, 3)
    sizes = np.array(curves.GetCurveVertexCountsAttr().Get(time) or [], dtype=np.int64)
    if wrap == "periodic":
        raise refuse(path, place, "open curves", "periodic ones", "export strands with a root and a tip")
    if (sizes < 0).any() or int(sizes.sum()) != len(points):
        raise refuse(path, place, f"curveVertexCounts that add up to {len(points)} points", str(int(sizes.sum())))
    attributes: dict[str, np.ndarray] = {}
    widths = np.array(curves.GetWidthsAttr().Get(time) or [], dtype=np.float64)
    if len(widths) in (1, len(sizes)) and len(widths) != len(points):
        widths = np.repeat(widths, sizes) if len(widths) == len(sizes) else np.full(len(points), widths[0])
    if len(widths):
        attributes["width"] = widths
    primvars = geometry.PrimvarsAPI(prim)
    for name, (primvar, channels) in {
        "root_uv": ("st", 2),
        "root_normal": ("rootNormal", 3),
        "color": ("displayColor", 3),
    }.items():
        found = primvars.GetPrimvar(primvar)
        values = found.ComputeFlattened(time) if found and found.HasValue() else None
        if values is not None and np.shape(values) == (len(sizes), channels):
            attributes[name] = np.array(values, dtype=np.float64)
    read = sampled(path, place, Curves(points, sizes, attributes), basis, pinned=wrap == "pinned")
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
