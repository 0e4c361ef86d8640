"""Compares the lengths of found strands with those of true strands."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.strands import lengths

ROOTED = 0.004
"""Largest distance from a true root to the root of a strand that is compared, metres: a head's scalp may be larger than
that of its hair, and strands on the rest of it have no true length."""


@dataclass(frozen=True)
class LengthAgreement:
    """Lengths of found strands that grow where true ones do, beside those of all true strands.

    Attributes:
        compared: number of found strands that grow there.
        median: median of their lengths, metres.
        at_95: 95th percentile of their lengths, metres.
        true_median: median of the true lengths, metres.
        true_at_95: 95th percentile of the true lengths, metres.
    """

    compared: int
    median: float
    at_95: float
    true_median: float
    true_at_95: float

    @property
    def ratios(self) -> tuple[float, float]:
        """Found to true: of the medians, and of the 95th percentiles."""
        return self.median / self.true_median, self.at_95 / self.true_at_95

    def as_dict(self) -> dict[str, float | int]:
        """The figures that `--json` prints: metres and ratios."""
        return {
            "compared": self.compared,
            "median_m": self.median,
            "true_median_m": self.true_median,
            "median_ratio": self.ratios[0],
            "95_m": self.at_95,
            "true_95_m": self.true_at_95,
            "95_ratio": self.ratios[1],
        }

    def as_text(self) -> str:
        """The same for people, without the number."""
        middle, long = self.ratios
        return (
            f"median {1e3 * self.median:.1f} mm, {middle:.2f} times the true {1e3 * self.true_median:.1f} mm; "
            f"95th percentile {1e3 * self.at_95:.1f} mm, {long:.2f} times the true {1e3 * self.true_at_95:.1f} mm"
        )


def compare_lengths(
    found: Float[Tensor, "found node 3"], truth: Float[Tensor, "true point 3"]
) -> LengthAgreement | None:
    """Compare the lengths of strands with those of true ones.

    Args:
        found: strands, root first, metres.
        truth: true strands, root first, metres.

    Returns:
        The agreement; None if no strand grows where a true one does, or most true strands have no length.
    """
    beside, _ = nearest(found[:, 0], truth[:, 0], ROOTED)
    ours, true = lengths(found[beside.isfinite()]).cpu(), lengths(truth).cpu()
    if len(ours) == 0 or not float(true.quantile(0.5)) > 0:
        return None
    quantiles = [float(each.quantile(share)) for each in (ours, true) for share in (0.5, 0.95)]
    return LengthAgreement(len(ours), *quantiles)
