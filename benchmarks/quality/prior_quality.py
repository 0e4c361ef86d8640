"""Accuracy of the strand prior compared with a PCA of the same size, on artists' grooms and on coils.

    python benchmarks/quality/prior_quality.py DATA [--weights FILE] [--optimise 200]

DATA is the folder that holds grooms/ (sintel_bob, straight_long, wavy_long, coil_swatch); without it only the
procedural coils are measured. None of these strands is among the training curves.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro
from torch import Tensor

from neural_strands.geometry.resample import resample_polyline_lengths, resample_strands
from neural_strands.grooms.io import read_groom
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.errors import reconstruction_error
from neural_strands.prior.pca import StrandPca
from neural_strands.prior.refine import refine_latents
from neural_strands.prior.vae import StrandPrior, load_prior
from neural_strands.prior_training.groom_strands import local_strands


def coils(shortest: float, longest: float, count: int = 2000) -> Tensor:
    """Coils of 3 to 8 mm radius and 15 to 40 mm pitch around arcs (lengths in metres); not those of prior.curves."""
    draw = torch.rand(count, 6, 1, generator=torch.Generator().manual_seed(0))
    t = torch.linspace(0, 1, 3000)[None]
    base = shortest + (longest - shortest) * draw[:, 0]
    radius, pitch, bend = 0.003 + 0.005 * draw[:, 1], 0.015 + 0.025 * draw[:, 2], 0.05 + 1.5 * draw[:, 3]
    turn = 2 * math.pi * (base / pitch * t + draw[:, 4])
    grown = radius * (1 - torch.exp(-t * base / 0.01))
    angle = bend * t
    x = base / bend * (1 - angle.cos()) + grown * turn.cos() * angle.cos()
    z = base / bend * angle.sin() - grown * turn.cos() * angle.sin()
    curve = torch.stack([x, grown * turn.sin(), z], dim=-1)
    return resample_polyline_lengths(curve - curve[:, :1], 100)


def swatch(path: Path) -> Tensor:
    """The first 8 of about 24 turns of each coil of the swatch (a file in centimetres), in its own axes."""
    groom = read_groom(path)
    cut = []
    for first, last in zip(groom.offsets[:-1].tolist(), groom.offsets[1:].tolist(), strict=True):
        points = groom.vertices[first : first + (last - first) // 3 + 1]
        cut.append(resample_strands(0.01 * (points - points[:1])[None], 100))
    return torch.cat(cut)


def sets(data: Path | None) -> dict[str, Tensor]:
    """All sets of strands, in local frames."""
    strands = {"coils, bases 8 to 20 cm": coils(0.08, 0.2), "coils, bases 20 to 35 cm": coils(0.2, 0.35)}
    if data is None:
        return strands
    grooms = data / "grooms"
    bob = next((grooms / "sintel_bob").glob("*.tfx"))
    return {
        "sintel_bob": local_strands(bob, grooms / "sintel_bob" / "sintel.obj"),
        "straight_long": local_strands(grooms / "straight_long" / "straight.hair", None),
        "wavy_long": local_strands(grooms / "wavy_long" / "harolongo.data", None),
        "coil_swatch, 8 turns": swatch(grooms / "coil_swatch" / "70.obj"),
        **strands,
    }


def row(name: str, decoded: Tensor, true: Tensor) -> str:
    e = reconstruction_error(decoded, true)
    return (
        f"  {name:22}{e.strands:7d}{e.mean_mm:9.3f}{e.median_mm:9.3f}{e.p95_mm:9.3f}{e.direction_deg:8.2f}"
        f"{e.length_percent:8.3f}{e.curvature_per_m:8.2f}"
    )


def report(prior: StrandPrior, pca: StrandPca, name: str, strands: Tensor, steps: int) -> None:
    print(name)
    latent = prior.encode(strands)
    print(row("prior", prior.decode(latent), strands))
    print(row("PCA", pca.decode(pca.encode(strands)), strands))
    if steps:
        every = max(1, len(strands) // 500)
        better = refine_latents(prior.generator, latent[::every], strands[::every], steps)
        print(row(f"optimised, {steps} steps", prior.decode(better), strands[::every]))
        bare = prior.without_modulator()
        start = bare.encode(strands[::every]) * 0
        better = refine_latents(bare.generator, start, strands[::every], steps, 0.1)
        print(row("  from the mean strand", bare.decode(better), strands[::every]))


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    data: Annotated[Path | None, tyro.conf.Positional] = None
    """Folder that holds grooms/; without it only the procedural coils are measured."""
    weights: Path | None = None
    """Weights of a prior, instead of those that ship with the package."""
    optimise: int = 0
    """Steps by which latents are also optimised; 0 for none."""
    curves: int = 20_000
    """Curves that the PCA is fitted to."""


def main(arguments: Arguments) -> None:
    prior = load_prior(arguments.weights)
    generator = torch.Generator().manual_seed(0)
    pca = StrandPca.fit(torch.cat([synthetic_curves(1000, generator) for _ in range(arguments.curves // 1000)]))
    print(f"  {'':22}strands  mean mm   median      p95   dir °   len %curv 1/m")
    for name, strands in sets(arguments.data).items():
        report(prior, pca, name, strands, arguments.optimise)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
