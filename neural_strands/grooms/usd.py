"""USD files (`.usd`, `.usdc` binary; `.usda` text): strands as one BasisCurves prim, which Blender and Houdini open.

Stored, as float32: points, root uv (primvar `st`, one value per strand), root normals (primvar `rootNormal`), widths
(`widths`, one value per point), colours (`displayColor`, one value per strand) and the share of a strand that no
photograph could see (primvar `unseen`). Writing: linear curves in metres, y up, rooted at the first point. Guides are a
second prim with the purpose `guide`; moving points have a time sample per frame. Reading: every BasisCurves prim of the
stage that is not a guide, linear or cubic (bezier, bspline, catmullRom: sampled along the curve), is converted to
metres, y up, +z front, by its transforms, metersPerUnit and upAxis.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from neural_strands.foundation.errors import excerpt
from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse
from neural_strands.grooms.groom import ATTRIBUTES, Groom
from neural_strands.grooms.motion import Motion
from neural_strands.grooms.usd_worker import PRIMVARS, REFUSED, pxr_module

LONGEST_READ = 600
"""Time after which reading a stage is abandoned, seconds."""
CRATE_HEADER = 24
"""Size of a binary file's header: magic, version and offset of the table of contents, 8 bytes each."""
VALUE_TYPES = {
    "root_uv": ("TexCoord2fArray", "Vec2fArray"),
    "root_normal": ("Normal3fArray", "Vec3fArray"),
    "color": ("Color3fArray", "Vec3fArray"),
    "unseen": ("FloatArray", "FloatArray"),
}
"""Type of each primvar, and the class of USD arrays that store it."""


def read_usd(path: Path) -> Groom:
    """Read all curves of a USD stage, in a separate process (see `usd_worker`).

    Raises:
        InputError: it is not a stage, has no curves, or its arrays disagree.
    """
    _check_container(path)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "arrays.npz"
        command = [sys.executable, "-m", "neural_strands.grooms.usd_worker", str(path.absolute()), str(target)]
        try:
            done = subprocess.run(
                command,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                stdin=subprocess.DEVNULL,
                timeout=LONGEST_READ,
                check=False,
                env={**os.environ, "PXR_WORK_THREAD_LIMIT": "1"},
            )
        except subprocess.TimeoutExpired as error:
            raise refuse(path, "byte 0", "a USD stage", f"one not read in {LONGEST_READ} s") from error
        if done.returncode == REFUSED:
            where, expected, found, advice = json.loads(done.stdout)
            raise refuse(path, where, expected, found, advice)
        if done.returncode != 0 or not target.is_file():
            found = f"a damaged one, at which USD's library stopped (status {done.returncode})"
            raise refuse(path, "byte 0", "a USD stage", found)
        with np.load(target) as archive:
            arrays = dict(archive)
    attributes = {name: arrays.get(name) for name in ATTRIBUTES}

    def locate(name: str, row: int) -> str:
        """Describe the row of an array, because USD does not report positions in the file."""
        return f"byte 0 (curves, row {row} of {name})"

    return build_groom(path, arrays["points"], arrays["sizes"], locate, attributes)


def write_usd(path: Path, groom: Groom, guides: Groom | None = None, motion: Motion | None = None) -> None:
    """Write a stage with the curves `/hair/strands`; `.usda` is text, the others binary.

    Args:
        path: the file.
        groom: the strands.
        guides: strands that represent those around them, written as `/hair/guides`.
        motion: positions of the points of `groom` in each frame.

    Raises:
        OSError: the file cannot be written.
    """
    sdf, usd, geometry, tf = (pxr_module(name) for name in ("Sdf", "Usd", "UsdGeom", "Tf"))
    layer = sdf.Layer.CreateAnonymous(".usda" if path.suffix.lower() == ".usda" else ".usdc")
    stage = usd.Stage.Open(layer)
    geometry.SetStageMetersPerUnit(stage, 1.0)
    geometry.SetStageUpAxis(stage, geometry.Tokens.y)
    stage.SetDefaultPrim(geometry.Xform.Define(stage, "/hair").GetPrim())
    curves = _define_curves(stage, "/hair/strands", groom)
    if motion is not None:
        _move(stage, curves, motion)
    if guides is not None:
        _define_curves(stage, "/hair/guides", guides).CreatePurposeAttr(geometry.Tokens.guide)
    try:
        layer.Export(str(path))
    except tf.ErrorException as error:
        reasons = re.findall(r"'([^']*)'\s*$", str(error), re.MULTILINE)
        found = reasons[0].strip(": ") if reasons else ""
        raise OSError(found or "USD's library could not write it") from error


def _define_curves(stage: Any, place: str, groom: Groom) -> Any:
    """Add a prim of curves."""
    sdf, geometry, arrays = (pxr_module(name) for name in ("Sdf", "UsdGeom", "Vt"))
    curves = geometry.BasisCurves.Define(stage, place)
    curves.CreateTypeAttr(geometry.Tokens.linear)
    curves.CreateWrapAttr(geometry.Tokens.nonperiodic)
    vertices = groom.vertices.cpu().float().numpy()
    curves.CreatePointsAttr(arrays.Vec3fArray.FromNumpy(vertices))
    curves.CreateCurveVertexCountsAttr(arrays.IntArray.FromNumpy(groom.sizes.cpu().numpy().astype(np.int32)))
    curves.CreateExtentAttr(_extent(vertices))
    if groom.width is not None:
        curves.CreateWidthsAttr(arrays.FloatArray.FromNumpy(groom.width.cpu().float().numpy()))
        curves.SetWidthsInterpolation(geometry.Tokens.vertex)
    primvars = geometry.PrimvarsAPI(curves)
    for name, (primvar, _) in PRIMVARS.items():
        if (value := getattr(groom, name)) is not None:
            kind, holder = VALUE_TYPES[name]
            array = getattr(arrays, holder)
            added = primvars.CreatePrimvar(primvar, getattr(sdf.ValueTypeNames, kind), geometry.Tokens.uniform)
            added.Set(array.FromNumpy(np.ascontiguousarray(value.cpu().float().numpy())))
    return curves


def _move(stage: Any, curves: Any, motion: Motion) -> None:
    """Write a sample of the points per frame; frames are numbered from 0."""
    arrays = pxr_module("Vt")
    stage.SetTimeCodesPerSecond(motion.fps)
    stage.SetFramesPerSecond(motion.fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(motion.frames - 1)
    for frame in range(motion.frames):
        vertices = motion.vertices(frame).cpu().float().numpy()
        curves.GetPointsAttr().Set(arrays.Vec3fArray.FromNumpy(vertices), frame)
        curves.GetExtentAttr().Set(_extent(vertices), frame)


def _extent(vertices: np.ndarray) -> Any:
    return pxr_module("Vt").Vec3fArray.FromNumpy(np.stack([vertices.min(axis=0), vertices.max(axis=0)]))


def _check_container(path: Path) -> None:
    """Reject a file that is neither text nor a binary stage whose table of contents lies inside it.

    Raises:
        InputError: the file is such a file.
    """
    data = read_groom_bytes(path)
    if data.startswith(b"#usda") and path.suffix.lower() != ".usdc":
        return
    if not data.startswith(b"PXR-USDC"):
        raise refuse(path, "byte 0", "a USD stage (#usda or PXR-USDC)", excerpt(data[:8]), "choose a .usd file")
    contents = int.from_bytes(data[16:CRATE_HEADER], "little")
    if len(data) < CRATE_HEADER or not CRATE_HEADER <= contents < len(data) - 8:
        found = f"{contents} in a file of {len(data)} bytes"
        raise refuse(path, "byte 16", "the table of contents inside the file", found, "it is truncated")
