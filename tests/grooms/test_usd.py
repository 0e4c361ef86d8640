"""USD as other programs write it: units, axes, transforms, cubic bases; oracles are pxr and scipy."""

# The bindings of USD have no stubs.
# pyright: reportAttributeAccessIssue=false

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from pxr import Gf, Usd, UsdGeom, Vt
from scipy.interpolate import BSpline

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom, write_groom

CONTROL = np.array([[0.0, 0, 0], [0, 1, 0], [1, 2, 0], [2, 2, 1], [3, 1, 1], [3, 0, 2], [4, 0, 2]])


def write_curves(path: Path, points: np.ndarray, counts: list[int], **tokens: str) -> Any:
    """A stage in centimetres, z up, with one BasisCurves below a transform."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    UsdGeom.SetStageUpAxis(stage, tokens.pop("up", "Y"))
    UsdGeom.Xform.Define(stage, "/a")
    curves = UsdGeom.BasisCurves.Define(stage, "/a/curves")
    curves.CreateTypeAttr(tokens.pop("type", "linear"))
    if "basis" in tokens:
        curves.CreateBasisAttr(tokens["basis"])
    if "wrap" in tokens:
        curves.CreateWrapAttr(tokens["wrap"])
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    curves.CreateCurveVertexCountsAttr(counts)
    return stage, curves


def test_written_stage_as_pxr_sees_it(tmp_path: Path, ragged_groom: Groom):
    """Metres, y up, one connected linear curve per strand, rooted at its first point."""
    write_groom(tmp_path / "a.usdc", ragged_groom)
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.GetDefaultPrim().GetPath() == "/hair"
    curves = UsdGeom.BasisCurves(stage.GetPrimAtPath("/hair/strands"))
    assert curves.GetTypeAttr().Get() == "linear"
    assert curves.GetWrapAttr().Get() == "nonperiodic"
    assert list(curves.GetCurveVertexCountsAttr().Get()) == [2, 9, 3, 5]
    assert curves.GetWidthsInterpolation() == "vertex"
    primvars = UsdGeom.PrimvarsAPI(curves)
    for name in ("st", "rootNormal", "displayColor"):
        assert primvars.GetPrimvar(name).GetInterpolation() == "uniform"
        assert len(primvars.GetPrimvar(name).Get()) == 4
    vertices = ragged_groom.vertices
    extent = torch.tensor(np.array(curves.GetExtentAttr().Get()))
    assert torch.equal(extent, torch.stack([vertices.amin(dim=0), vertices.amax(dim=0)]))


def test_units_axes_and_transform(tmp_path: Path):
    """z up in centimetres, moved by (0, 0, 5) above: (x, y, z) cm -> (x, z + 5, -y) / 100 m; widths follow."""
    points = np.array([[1.0, 2, 3], [1, 2, 4]])
    stage, curves = write_curves(tmp_path / "a.usda", points, [2], up="Z")
    curves.CreateWidthsAttr([0.5])
    curves.SetWidthsInterpolation("constant")
    UsdGeom.Xformable(stage.GetPrimAtPath("/a")).AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    stage.Save()
    groom = read_groom(tmp_path / "a.usda")
    torch.testing.assert_close(groom.vertices, torch.tensor([[0.01, 0.08, -0.02], [0.01, 0.09, -0.02]]))
    assert groom.width is not None
    torch.testing.assert_close(groom.width, torch.full((2,), 0.005))


def test_several_prims_are_joined(tmp_path: Path):
    stage, _ = write_curves(tmp_path / "a.usda", CONTROL, [3, 4])
    more = UsdGeom.BasisCurves.Define(stage, "/b")
    more.CreateTypeAttr("linear")
    more.CreatePointsAttr([Gf.Vec3f(0, 0, 0), Gf.Vec3f(0, 1, 0)])
    more.CreateCurveVertexCountsAttr([2])
    stage.Save()
    assert sorted(read_groom(tmp_path / "a.usda").sizes.tolist()) == [2, 3, 4]


def test_bspline_against_scipy(tmp_path: Path):
    stage, _ = write_curves(tmp_path / "a.usda", CONTROL, [7], type="cubic", basis="bspline", wrap="nonperiodic")
    stage.Save()
    found = read_groom(tmp_path / "a.usda").vertices.numpy() * 100
    exact = BSpline(np.arange(-3.0, 8.0), CONTROL, 3)(np.linspace(0, 4, 17))
    np.testing.assert_allclose(found, exact, atol=1e-4)


def test_bezier_against_bernstein(tmp_path: Path):
    stage, _ = write_curves(tmp_path / "a.usda", CONTROL, [7], type="cubic", basis="bezier", wrap="nonperiodic")
    stage.Save()
    found = read_groom(tmp_path / "a.usda").vertices.numpy() * 100
    t = np.linspace(0, 1, 5)[:, None]
    halves = [
        (1 - t) ** 3 * p[0] + 3 * t * (1 - t) ** 2 * p[1] + 3 * t**2 * (1 - t) * p[2] + t**3 * p[3]
        for p in (CONTROL[:4], CONTROL[3:])
    ]
    np.testing.assert_allclose(found, np.concatenate([halves[0][:-1], halves[1]]), atol=1e-4)


@pytest.mark.parametrize("basis", ["catmullRom", "bspline"])
def test_pinned_curves_reach_their_ends(basis: str, tmp_path: Path):
    """Two curves, so that the phantom points at their border must not be mixed up."""
    stage, _ = write_curves(tmp_path / "a.usda", CONTROL, [3, 4], type="cubic", basis=basis, wrap="pinned")
    stage.Save()
    groom = read_groom(tmp_path / "a.usda")
    assert groom.sizes.tolist() == [9, 13]
    ends = groom.vertices[[0, 8, 9, 21]].numpy() * 100
    np.testing.assert_allclose(ends, CONTROL[[0, 2, 3, 6]], atol=1e-4)
    if basis == "catmullRom":
        through = groom.vertices[[4, 13, 17]].numpy() * 100
        np.testing.assert_allclose(through, CONTROL[[1, 4, 5]], atol=1e-4)


def test_varying_widths_of_cubic_curves(tmp_path: Path):
    stage, curves = write_curves(tmp_path / "a.usda", CONTROL, [7], type="cubic", basis="bspline", wrap="nonperiodic")
    curves.CreateWidthsAttr([1.0, 2, 3, 4, 5])
    curves.SetWidthsInterpolation("varying")
    stage.Save()
    width = read_groom(tmp_path / "a.usda").width
    assert width is not None
    np.testing.assert_allclose(width.numpy() * 100, np.linspace(1, 5, 17), rtol=1e-5)


@pytest.mark.parametrize(
    ("counts", "tokens", "words"),
    [
        ([3, 3], {}, "curveVertexCounts that add up to 7 points, found 6"),
        ([8, -1], {}, "curveVertexCounts"),
        ([2_000_000_000], {}, "curveVertexCounts"),
        ([7], {"type": "cubic", "basis": "bspline", "wrap": "periodic"}, "open curves"),
        ([3, 4], {"type": "cubic", "basis": "bspline", "wrap": "nonperiodic"}, "curve 0 with 3"),
        ([6, 1], {}, "strand 1 with 1"),
    ],
)
def test_curves_that_lie(counts: list[int], tokens: dict, words: str, tmp_path: Path, capfd: pytest.CaptureFixture):
    stage, _ = write_curves(tmp_path / "a.usda", CONTROL, counts, **tokens)
    stage.Save()
    capfd.readouterr()
    with pytest.raises(InputError, match=words):
        read_groom(tmp_path / "a.usda")
    captured = capfd.readouterr()
    assert captured.out + captured.err == ""
