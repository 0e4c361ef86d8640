"""Errors of decoded strands against the true ones."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import lengths, segments


@dataclass(frozen=True)
class ReconstructionError:
    """Errors over all strands and points.

    Attributes:
        strands: number of strands compared.
        mean_mm: mean distance of corresponding points.
        median_mm: median distance of corresponding points.
        p95_mm: 95th percentile of these distances.
        direction_deg: mean angle between corresponding segments.
        length_percent: mean absolute error of the length.
        curvature_per_m: mean absolute error of the curvature (turning angle over length).
    """

    strands: int
    mean_mm: float
    median_mm: float
    p95_mm: float
    direction_deg: float
    length_percent: float
    curvature_per_m: float


def reconstruction_error(
    decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"]
) -> ReconstructionError:
    """Compare strands point by point; both in metres."""
    distance = 1000 * (decoded - true).norm(dim=-1).flatten().double()
    middle, high = (percentile(distance, share) for share in (0.5, 0.95))
    angle = angles(segments(decoded), segments(true))
    length, true_length = lengths(decoded), lengths(true)
    curvature = (curvatures(decoded) - curvatures(true)).abs()
    return ReconstructionError(
        strands=len(true),
        mean_mm=float(distance.mean()),
        median_mm=middle,
        p95_mm=high,
        direction_deg=float(torch.rad2deg(angle).mean()),
        length_percent=100 * float((length / true_length - 1).abs().mean()),
        curvature_per_m=float(curvature.mean()),
    )


def strand_errors(
    decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"]
) -> Float[Tensor, " strand"]:
    """Mean point error of each strand, millimetres."""
    return 1000 * (decoded - true).norm(dim=-1).mean(dim=1)


def angles(first: Float[Tensor, "*batch 3"], second: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
    """Angle between vectors, radians, exact for small angles too (atan2 of cross and dot product)."""
    cross = torch.linalg.cross(first, second, dim=-1).norm(dim=-1)
    return torch.atan2(cross, (first * second).sum(dim=-1))


def curvatures(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point-2"]:
    """Turning angle over mean segment length at each inner point, 1/m."""
    steps = segments(points)
    length = steps.norm(dim=-1)
    return angles(steps[:, :-1], steps[:, 1:]) / (0.5 * (length[:, :-1] + length[:, 1:])).clamp(min=1e-9)


def percentile(values: Float[Tensor, " value"], share: float) -> float:
    """The value below which this share lies (nearest rank; torch.quantile does not accept millions of values)."""
    if len(values) == 0:
        return 0.0
    return float(values.kthvalue(max(1, round(share * len(values)))).values)
