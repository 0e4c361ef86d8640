"""`neural-strands prior-traverse`: what the latent of the strand prior controls, as pictures and correlations."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device, seeded
from neural_strands.cli.streams import print_json
from neural_strands.foundation.configs import Between

if TYPE_CHECKING:
    from torch import Tensor

    from neural_strands.pictures.plots import Panel
    from neural_strands.prior.vae import StrandPrior

REACH = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
"""Positions along a direction that are drawn, in standard deviations."""


@dataclass(frozen=True)
class PriorTraverse:
    """Draw strands along the latent's directions, ordered by effect, and find those of length, curliness and bend.

    Writes traversal.png (one row per direction: first those that correlate best with length, curliness and bend, then
    the latents that move strands most), samples.png (strands drawn from N(0, I)) and interpolation.png (between two
    synthetic curves per row) into OUT, and traversal.json with all effects and correlations.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """Folder for pictures and numbers."""
    weights: Path | None = None
    """Weights of the prior; those shipped with the package by default."""
    latents: Annotated[int, Between(0, 1_000)] = 9
    """Number of latents to draw, those with the largest effect first."""
    samples: Annotated[int, Between(100, 1_000_000)] = 4000
    """Number of samples of N(0, I) over which effects and correlations are measured."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Seed of the samples and curves."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object: the direction and correlation of each measure, and the latents by effect."""

    def run(self) -> None:
        """Measure, draw, print."""
        import torch

        from neural_strands.foundation.files import check_writable, write_json
        from neural_strands.pictures.encoding import write_png
        from neural_strands.pictures.plots import Panel, panels_plot
        from neural_strands.prior.curves import synthetic_curves
        from neural_strands.prior.traversal import MEASURES, traverse
        from neural_strands.prior.vae import load_prior

        check_writable(self.out / "traversal.png")
        device, generator = pick_device(self.device), seeded(self.seed)
        prior = load_prior(self.weights, device)
        size = prior.generator.config.latent
        drawn = torch.randn(self.samples, size, generator=generator).to(device)
        result = traverse(prior.generator, drawn)
        order = result.effect_mm.argsort(descending=True).tolist()
        unit = torch.eye(size, device=device)
        rows = [_along(prior, direction) for direction in result.direction]
        labels = [f"{name}\nr = {float(r):.2f}" for name, r in zip(MEASURES, result.direction_correlation, strict=True)]
        rows += [_along(prior, unit[index]) for index in order[: self.latents]]
        labels += [f"latent {index}\n{float(result.effect_mm[index]):.1f} mm" for index in order[: self.latents]]
        legend = "strands along latent directions, in deviations; cm"
        write_png(self.out / "traversal.png", panels_plot(rows, labels, legend))
        strands = prior.decode(drawn[:50]).unflatten(0, (5, 10))
        samples = [[Panel((strand,)) for strand in row] for row in strands]
        write_png(self.out / "samples.png", panels_plot(samples, (), "samples of N(0, I)"))
        ends = prior.encode(synthetic_curves(12, generator).to(device)).unflatten(0, (6, 2))
        between = [_between(prior, first, last) for first, last in ends]
        write_png(self.out / "interpolation.png", panels_plot(between, (), "between two synthetic curves"))
        numbers = {
            "directions": {
                name: {
                    "correlation": float(result.direction_correlation[index]),
                    "best_latent": int(result.correlation[:, index].abs().argmax()),
                    "best_latent_correlation": float(result.correlation[:, index].abs().max()),
                    "direction": result.direction[index].tolist(),
                }
                for index, name in enumerate(MEASURES)
            },
            "latents_by_effect": [{"latent": i, "effect_mm": float(result.effect_mm[i])} for i in order],
        }
        write_json(self.out / "traversal.json", numbers)
        if self.json:
            print_json(numbers)
            return
        for name, found in numbers["directions"].items():
            sys.stdout.write(
                f"{name}: correlation {found['correlation']:.2f} along its direction, "
                f"{found['best_latent_correlation']:.2f} with latent {found['best_latent']} alone\n"
            )
        sys.stdout.write(f"{self.out}: traversal.png, samples.png, interpolation.png, traversal.json\n")


def _along(prior: "StrandPrior", direction: "Tensor") -> "list[Panel]":
    """Strands at places along a direction from the mean."""
    from neural_strands.pictures.plots import Panel

    places = direction.new_tensor(REACH)
    strands = prior.decode(places[:, None] * direction)
    return [Panel((strand,), f"{place:+g}") for strand, place in zip(strands, REACH, strict=True)]


def _between(prior: "StrandPrior", first: "Tensor", last: "Tensor") -> "list[Panel]":
    """Strands on the straight line between two latents."""
    import torch

    from neural_strands.pictures.plots import Panel

    shares = torch.linspace(0, 1, 7, device=first.device)
    strands = prior.decode(torch.lerp(first[None], last[None], shares[:, None]))
    return [Panel((strand,), f"{float(share):.2f}") for strand, share in zip(strands, shares, strict=True)]
