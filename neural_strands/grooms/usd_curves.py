"""Converts cubic curves to polylines: the bases of USD's BasisCurves, evaluated at several points per segment."""

from dataclasses import dataclass, replace

import numpy as np

SAMPLES = 4
"""Points per cubic segment."""
MATRICES = {
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]], dtype=np.float64),
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0,
    "catmullRom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2.0,
}
"""Rows: coefficients of 1, t, t^2, t^3; columns: the four control points (the public definition of each basis)."""


class StageError(Exception):
    """A stage cannot be read as hair; says where, what was expected, what was found and what to do."""

    def __init__(self, where: str, expected: str, found: str, advice: str = "export it again") -> None:
        super().__init__(where, expected, found, advice)


@dataclass(frozen=True)
class Curves:
    """Control points or samples of several curves.

    Attributes:
        points: points of all curves, concatenated, (point, 3).
        sizes: number of points of each curve.
        attributes: arrays by the attribute names of a groom; `width` has one row per point, the others one row per
            curve.
    """

    points: np.ndarray
    sizes: np.ndarray
    attributes: dict[str, np.ndarray]


def sampled(place: str, curves: Curves, basis: str, pinned: bool) -> Curves:
    """Turn control points into points on the curves; linear ones are returned as they are.

    Pinned bspline and catmullRom curves reach their end points: a phantom point is added at each end
    (2 p0 - p1), as USD defines it.

    Raises:
        StageError: the basis is unknown, or does not allow the number of points.
    """
    if basis == "linear":
        return curves
    if basis not in MATRICES:
        raise StageError(place, "the basis linear, bezier, bspline or catmullRom", basis)
    width = curves.attributes.get("width")
    pinned = pinned and basis != "bezier"
    step = 3 if basis == "bezier" else 1
    least = 2 if pinned else 4
    wrong = (curves.sizes < least) | ((curves.sizes - 1) % step != 0)
    if wrong.any():
        first = int(wrong.argmax())
        expected = f"a number of points that {basis} allows"
        raise StageError(place, expected, f"curve {first} with {curves.sizes[first]}")
    segments = (curves.sizes - 1) // 3 if basis == "bezier" else curves.sizes - (1 if pinned else 3)
    varying = width is not None and len(width) == int((segments + 1).sum()) and len(width) != len(curves.points)
    values = curves.points
    if width is not None and len(width) == len(curves.points):
        values = np.concatenate([values, width[:, None]], axis=1)
    sizes = curves.sizes
    if pinned:
        values, sizes = _with_phantoms(values, sizes)
    found, counts = _evaluate(values, sizes, segments, basis, step)
    attributes = dict(curves.attributes)
    if varying and width is not None:
        attributes["width"] = _between(width, segments)
    elif values.shape[1] > 3:
        attributes["width"] = np.maximum(found[:, 3], 0.0)
    return replace(curves, points=found[:, :3], sizes=counts, attributes=attributes)


def _with_phantoms(values: np.ndarray, sizes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Add the reflected end points."""
    ends = np.cumsum(sizes)
    starts = ends - sizes
    before = 2 * values[starts] - values[starts + 1]
    after = 2 * values[ends - 1] - values[ends - 2]
    where = np.concatenate([starts, ends])
    # At a boundary, the phantom after one curve precedes the phantom before the next.
    border = np.lexsort((np.concatenate([np.ones(len(starts)), np.zeros(len(ends))]), where))
    return np.insert(values, where[border], np.concatenate([before, after])[border], axis=0), sizes + 2


def _evaluate(
    values: np.ndarray, sizes: np.ndarray, segments: np.ndarray, basis: str, step: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points at t = 0, 1/SAMPLES, ... of every segment, and the end of each curve's last one."""
    starts = np.cumsum(sizes) - sizes
    within = np.arange(int(segments.sum())) - np.repeat(np.cumsum(segments) - segments, segments)
    first = np.repeat(starts, segments) + step * within
    control = values[first[:, None] + np.arange(4)]
    t = np.arange(SAMPLES + 1) / SAMPLES
    weights = np.stack([np.ones_like(t), t, t**2, t**3], axis=1) @ MATRICES[basis]
    points = np.einsum("tk,skc->stc", weights, control)
    keep = np.ones(points.shape[:2], dtype=bool)
    keep[:, SAMPLES] = False
    keep[np.cumsum(segments) - 1, SAMPLES] = True
    return points[keep], segments * SAMPLES + 1


def _between(width: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """Widths given at the ends of segments, at their samples (linear)."""
    counts = segments * SAMPLES + 1
    within = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    start = np.repeat(np.cumsum(segments + 1) - (segments + 1), counts)
    left = np.minimum(within // SAMPLES, np.repeat(segments, counts) - 1)
    weight = within / SAMPLES - left
    return width[start + left] * (1 - weight) + width[start + left + 1] * weight
