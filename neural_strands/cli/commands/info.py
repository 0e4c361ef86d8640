"""`neural-strands info`: the contents of a groom."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from neural_strands.cli.streams import print_json

if TYPE_CHECKING:
    from neural_strands.grooms.groom import Groom

ROOT_SPAN = 0.2
"""Metres that the roots of a whole head of hair span along the longest axis (0.18 to 0.22 on adults)."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Units that can be guessed, in metres."""
TOLERANCE = 1.8
"""A unit is named if the roots then span a head to within this factor."""


@dataclass(frozen=True)
class Info:
    """Print the contents of a groom: strands, points, bounding box, lengths, and a guess of the unit.

    Everything is in the unit of the file (USD: metres). The guess assumes that the roots cover a whole head, 0.2 m
    along the longest axis.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Groom: .hair, .data, .tfx, .usd, .usda, .usdc, .ply, .obj or .npz."""
    json: bool = False
    """Print one JSON object: strands, points, bbox_min, bbox_max, length_median, unit_guess, and more."""

    def run(self) -> None:
        """Read the file and print the table."""
        from neural_strands.grooms.io import read_groom

        facts = summary(read_groom(self.file))
        if self.json:
            print_json({"file": str(self.file), **facts})
            return
        low, high = facts["bbox_min"], facts["bbox_max"]
        per_strand = [facts[f"points_per_strand_{name}"] for name in ("min", "max")]
        unit = facts["unit_guess"]
        rows = {
            "strands": f"{facts['strands']}",
            "points": f"{facts['points']} ({per_strand[0]} to {per_strand[1]} per strand)",
            "bounding box": f"{_triple(low)} to {_triple(high)}",
            "length": f"{facts['length_median']:.4g} median, {facts['length_min']:.4g} to {facts['length_max']:.4g}",
            "attributes": ", ".join(facts["attributes"]) or "none",
            "unit": f"{unit} (guess; about {facts['metres_per_unit_guess']:.2g} m per unit if the roots cover a head)",
        }
        sys.stdout.write("".join(f"{name:<14}{value}\n" for name, value in rows.items()))


def summary(groom: "Groom") -> dict[str, Any]:
    """Return the facts of a groom as plain numbers, in its own unit."""
    from neural_strands.grooms.groom import ATTRIBUTES

    lengths, sizes, roots = groom.lengths(), groom.sizes, groom.roots
    span = float((roots.amax(dim=0) - roots.amin(dim=0)).max())
    metres = ROOT_SPAN / span if span > 0 else math.nan
    return {
        "strands": len(groom),
        "points": len(groom.vertices),
        "points_per_strand_min": int(sizes.min()),
        "points_per_strand_max": int(sizes.max()),
        "bbox_min": groom.vertices.amin(dim=0).tolist(),
        "bbox_max": groom.vertices.amax(dim=0).tolist(),
        "length_min": float(lengths.min()),
        "length_median": float(lengths.quantile(0.5)),
        "length_max": float(lengths.max()),
        "attributes": [name for name in ATTRIBUTES if getattr(groom, name) is not None],
        "unit_guess": unit_name(span),
        "metres_per_unit_guess": metres if math.isfinite(metres) else None,
    }


def unit_name(root_span: float) -> str:
    """Name the unit in which roots that span `root_span` would cover a head, or "unknown"."""
    if root_span <= 0:
        return "unknown"
    misfit = {name: abs(math.log(root_span * metres / ROOT_SPAN)) for name, metres in UNITS.items()}
    best = min(misfit, key=misfit.__getitem__)
    return best if misfit[best] < math.log(TOLERANCE) else "unknown"


def _triple(values: list[float]) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
