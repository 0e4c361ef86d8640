"""Agreement of strands or line segments with true strands.

A point counts as matched when the other set has a point within a distance whose direction deviates by no more than an
angle (the paper's evaluation on synthetic hair, after Nam et al. 2019). Precision is the matched share of the
predicted points, recall that of the true ones, F their harmonic mean; all in percent. Unsigned figures take a
direction and its opposite as the same; signed ones do not.

In dense hair a strand that has strayed sideways finds another strand to match. These figures tell whether there is hair
and whether it runs the right way, not whether each strand is right; `consistency` measures that.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.evaluation.consistency import consistency
from neural_strands.evaluation.oriented_points import OrientedPoints
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import match_levels
from neural_strands.geometry.signed_distance import SignedDistanceIndex


@dataclass(frozen=True)
class Threshold:
    """What counts as a match.

    Attributes:
        distance: largest distance, metres.
        angle: largest deviation, radians.
    """

    distance: float
    angle: float

    @property
    def name(self) -> str:
        """Its key in reports, for instance 2mm/20deg."""
        return f"{1e3 * self.distance:g}mm/{math.degrees(self.angle):g}deg"


THRESHOLDS = tuple(Threshold(k * 1e-3, math.radians(10 * k)) for k in (1, 2, 3, 4))
"""(1 mm, 10°), (2 mm, 20°), (3 mm, 30°), (4 mm, 40°)."""
CONSISTENCY_EVERY = 4
"""Every fourth true sample (2 mm apart) counts for strand consistency."""
HEAD_POINTS = 200_000
"""Largest number of predicted points, evenly spread over all, that are tested against the head."""
CLEARLY_INSIDE = 2e-3
"""Depth in metres beyond which a point is certainly inside; roots scatter around the fitted surface."""


@dataclass(frozen=True)
class Agreement:
    """Percentages of points that match, and their harmonic mean."""

    precision: float
    recall: float

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall, percent."""
        total = self.precision + self.recall
        return 2 * self.precision * self.recall / total if total > 0 else 0.0

    def as_dict(self) -> dict[str, float]:
        """The figures that `--json` prints, percent."""
        return {"precision": self.precision, "recall": self.recall, "f_score": self.f_score}


@dataclass(frozen=True)
class GeometryScore:
    """Agreement at one threshold.

    Attributes:
        threshold: what counts as a match.
        unsigned: directions without a sign.
        signed: directions from root to tip.
        strand_consistency: mean over true strands of the largest share of one strand's points that one single
            predicted strand matches, percent (HairGS); unsigned.
    """

    threshold: Threshold
    unsigned: Agreement
    signed: Agreement
    strand_consistency: float | None = None

    def as_dict(self) -> dict[str, float | dict[str, float] | None]:
        """The figures that `--json` prints, percent."""
        return {
            **self.unsigned.as_dict(),
            "strand_consistency": self.strand_consistency,
            "signed": self.signed.as_dict(),
        }


@dataclass(frozen=True)
class HeadFit:
    """Position of predicted strands relative to the head.

    Attributes:
        inside: percent of points beneath the head's surface.
        clearly_inside: percent of points more than 2 mm beneath it.
        root_median: median distance of roots from the scalp, metres.
        root_95: 95th percentile of that distance, metres.
        root_largest: largest such distance, metres.
    """

    inside: float
    clearly_inside: float
    root_median: float
    root_95: float
    root_largest: float


def matched_shares(
    queries: OrientedPoints, others: OrientedPoints, thresholds: Sequence[Threshold] = THRESHOLDS
) -> tuple[list[float], list[float]]:
    """Percentage of `queries` that `others` match at each threshold: unsigned, then signed (0 without queries)."""
    pairs = [(threshold.distance, threshold.angle) for threshold in thresholds]
    grid = PointGrid.build(others.points, pairs[-1][0])
    levels = match_levels(queries.points, queries.directions, grid, others.directions, pairs)
    shares = [[_percent(level <= k) for k in range(len(pairs))] for level in levels]
    return shares[0], shares[1]


def score_geometry(
    predicted: OrientedPoints,
    truth: OrientedPoints,
    thresholds: Sequence[Threshold] = THRESHOLDS,
    with_consistency: bool = True,
) -> tuple[GeometryScore, ...]:
    """Compute precision, recall, F and strand consistency at each threshold.

    Args:
        predicted: samples of the predicted strands or segments.
        truth: samples of the true strands.
        thresholds: what counts as a match, from strict to lax.
        with_consistency: whether to compute strand consistency, which needs whole strands.
    """
    precision, signed_precision = matched_shares(predicted, truth, thresholds)
    recall, signed_recall = matched_shares(truth, predicted, thresholds)
    consistent: list[float] | None = None
    if with_consistency:
        pairs = [(threshold.distance, threshold.angle) for threshold in thresholds]
        consistent = consistency(predicted, truth.thinned(CONSISTENCY_EVERY), pairs)
    return tuple(
        GeometryScore(
            threshold,
            Agreement(precision[k], recall[k]),
            Agreement(signed_precision[k], signed_recall[k]),
            None if consistent is None else 100 * consistent[k],
        )
        for k, threshold in enumerate(thresholds)
    )


def fit_to_head(
    predicted: OrientedPoints, head: Mesh, scalp_faces: Int64[Tensor, " scalp"] | None = None
) -> HeadFit | None:
    """Position of points and roots relative to a head; roots are compared with the scalp's faces (all faces if None).

    Returns:
        The fit, or None if there are no points.
    """
    if len(predicted) == 0:
        return None
    every = max(1, math.ceil(len(predicted) / HEAD_POINTS))
    depth = -SignedDistanceIndex(head)(predicted.points[::every]).distance
    scalp = head if scalp_faces is None else Mesh(head.vertices, head.faces[scalp_faces])
    away = _quantiles(SignedDistanceIndex(scalp)(predicted.roots()).distance.abs())
    return HeadFit(_percent(depth > 0), _percent(depth > CLEARLY_INSIDE), *away)


def _percent(hits: Tensor) -> float:
    return 100 * float(hits.double().mean()) if len(hits) else 0.0


def _quantiles(distance: Float[Tensor, " root"]) -> tuple[float, float, float]:
    """Median, 95th percentile and maximum."""
    ordered = distance.sort().values
    last = len(ordered) - 1
    return float(ordered[round(0.5 * last)]), float(ordered[round(0.95 * last)]), float(ordered[last])
