"""`.abc` files (Alembic) with the groom attributes that Unreal Engine reads, through the module `alembic3d`.

Strands and guides are one set of linear curves each, in metres, y up; Unreal asks for the scale to centimetres (100)
and the axes when it imports. Following Epic's "Alembic for Grooms" 1.5, each set has `groom_version_major`,
`groom_version_minor`, `groom_group_id` (0) and `groom_guide` (0 or 1); per strand `groom_id`, `groom_root_uv` and
`groom_color` (linear); and per point `groom_width`. Widths are also stored as those of the curves, for other programs,
and the share of a strand that no photograph could see as `unseen`, per strand, as in USD files.
"""

import importlib
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from neural_strands.grooms.groom import Groom
from neural_strands.grooms.motion import Motion

MODULE = "alembic3d"
VERSION = (1, 5)
"""Version of Epic's schema."""


def is_available() -> bool:
    """Whether the module is installed."""
    return importlib.util.find_spec(MODULE) is not None


def write_unreal_alembic(path: Path, groom: Groom, guides: Groom | None, motion: Motion | None) -> None:
    """Write strands, guides and motion."""
    abc = importlib.import_module(f"{MODULE}.Abc")
    archive = abc.OArchive(str(path))
    top = archive.getTop()
    _write_curves(archive, top, "strands", groom, 0, motion)
    if guides is not None:
        _write_curves(archive, top, "guides", guides, 1, None)
    # The file is completed when the last reference to the archive is gone.
    del top, archive


def _write_curves(archive: Any, top: Any, name: str, groom: Groom, guide: int, motion: Motion | None) -> None:
    abc, geometry, core = (
        importlib.import_module(f"{MODULE}.{part}") for part in ("Abc", "AbcGeom", "AbcCoreAbstract")
    )
    imath: Any = importlib.import_module("imath")
    scope = geometry.GeometryScope
    timing = []
    if motion is not None:
        timing = [abc.Argument(archive.addTimeSampling(core.TimeSampling(1 / motion.fps, 0.0)))]
    schema = geometry.OCurves(top, name, *timing).getSchema()
    sizes = imath.IntArrayFromBuffer(_plain(groom.sizes, np.int32))
    width = None if groom.width is None else imath.FloatArrayFromBuffer(_plain(groom.width, np.float32))
    for frame in range(1 if motion is None else motion.frames):
        vertices = groom.vertices if motion is None else motion.vertices(frame)
        points = imath.V3fArrayFromBuffer(_plain(vertices, np.float32))
        sample = geometry.OCurvesSchemaSample(
            points, sizes, geometry.CurveType.kLinear, geometry.CurvePeriodicity.kNonPeriodic
        )
        # Polylines have no basis; with the default, Blender would draw Bezier curves.
        sample.setBasis(geometry.BasisType.kNoBasis)
        if width is not None and frame == 0:
            sample.setWidths(geometry.OFloatGeomParamSample(width, scope.kVertexScope))
        schema.set(sample)
    attributes = schema.getArbGeomParams()

    def put(kind: str, attribute: str, values: Any, where: Any) -> None:
        parameter = getattr(geometry, f"O{kind}GeomParam")(attributes, attribute, False, where, 1)
        parameter.set(getattr(geometry, f"O{kind}GeomParamSample")(values, where))

    for attribute, number in (("version_major", VERSION[0]), ("version_minor", VERSION[1]), ("guide", guide)):
        put("Int16", f"groom_{attribute}", _one(imath.ShortArray, number), scope.kConstantScope)
    put("Int32", "groom_group_id", _one(imath.IntArray, 0), scope.kConstantScope)
    ids = imath.IntArrayFromBuffer(np.arange(len(groom), dtype=np.int32))
    put("Int32", "groom_id", ids, scope.kUniformScope)
    if groom.root_uv is not None:
        uv = imath.V2fArrayFromBuffer(_plain(groom.root_uv, np.float32))
        put("V2f", "groom_root_uv", uv, scope.kUniformScope)
    if width is not None:
        put("Float", "groom_width", width, scope.kVertexScope)
    if groom.color is not None:
        colours = imath.C3fArray(len(groom))
        for index, colour in enumerate(groom.color.tolist()):
            colours[index] = imath.Color3f(*colour)
        put("C3f", "groom_color", colours, scope.kUniformScope)
    if groom.unseen is not None:
        unseen = imath.FloatArrayFromBuffer(_plain(groom.unseen, np.float32))
        put("Float", "unseen", unseen, scope.kUniformScope)


def _one(kind: Any, value: int) -> Any:
    """An array of a single value."""
    array = kind(1)
    array[0] = value
    return array


def _plain(values: Tensor, kind: type) -> np.ndarray:
    """Values as a contiguous array of a numpy type."""
    return np.ascontiguousarray(values.detach().cpu().numpy(), kind)
