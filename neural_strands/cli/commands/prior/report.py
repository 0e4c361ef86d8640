"""`neural-strands prior-report`: how well the strand prior reproduces the strands of grooms."""

import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device, seeded
from neural_strands.cli.streams import print_json
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

    from neural_strands.pictures.plots import Panel
    from neural_strands.prior.errors import ReconstructionError
    from neural_strands.prior.pca import StrandPca
    from neural_strands.prior.vae import StrandPrior


@dataclass(frozen=True)
class PriorReport:
    """Encode and decode every strand of each groom, and report the errors beside those of a PCA of the same size.

    Errors: mean, median and 95th percentile of the distance of points (mm), of directions (degrees), length (%) and
    curvature (1/m). The PCA is fitted to the training curves. "optimised" is the error after Adam has
    optimised each latent for the decoder alone, starting from its encoding.
    """

    grooms: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Groom files, capture folders or their ground_truth.npz; strands that are not finite or shorter than 3 mm are left
    out."""
    head: tuple[Path, ...] = ()
    """Head of each groom, in its frame and metres; scalp_faces.json beside it is used. Default: the capture's own, or
    the mannequin fitted to the roots."""
    weights: Path | None = None
    """Weights of the prior; those shipped with the package by default."""
    picture: Path | None = None
    """File for a picture of the worst, median and best strands (.png)."""
    optimise_steps: Annotated[int, Between(0, 1_000_000)] = 0
    """Steps for which latents are also optimised; 0 for none."""
    optimise_strands: int = 2000
    """Number of strands, spread over the groom, whose latents are optimised."""
    curves: Annotated[int, Between(1, 10_000_000)] = 20000
    """Number of training curves that the PCA is fitted to."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Seed of the training curves."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object: for each groom "prior", "pca" and "optimised" with their errors."""

    def run(self) -> None:
        """Report on each groom."""
        import torch

        from neural_strands.prior.curves import synthetic_curves
        from neural_strands.prior.pca import StrandPca
        from neural_strands.prior.vae import load_prior
        from neural_strands.prior_training.groom_strands import local_strands

        if not self.grooms:
            raise InputError("prior-report: expected at least one groom file, found none.")
        if self.head and len(self.head) != len(self.grooms):
            raise InputError(f"--head: expected one per groom ({len(self.grooms)}), found {len(self.head)}.")
        device = pick_device(self.device)
        prior = load_prior(self.weights, device)
        heads = self.head or (None,) * len(self.grooms)
        read = [local_strands(path, head).to(device) for path, head in zip(self.grooms, heads, strict=True)]
        generator = seeded(self.seed)
        parts = [min(1000, self.curves - start) for start in range(0, self.curves, 1000)]
        curves = torch.cat([synthetic_curves(part, generator) for part in parts]).to(device)
        pca = StrandPca.fit(curves, prior.generator.config.latent)
        report, panels, labels = {}, [], []
        for name, strands in zip(_names(self.grooms), read, strict=True):
            errors = self._errors(prior, pca, strands)
            report[name] = {kind: asdict(error) for kind, error in errors.items()}
            panels.append(_panels(prior, strands))
            labels.append(name)
            if not self.json:
                sys.stdout.write(_table(name, errors))
        if self.picture is not None:
            from neural_strands.pictures.encoding import write_png
            from neural_strands.pictures.plots import panels_plot

            write_png(self.picture, panels_plot(panels, labels, "true (black), encoded and decoded (red); cm"))
        if self.json:
            print_json(report)

    def _errors(self, prior: "StrandPrior", pca: "StrandPca", strands: "Tensor") -> "dict[str, ReconstructionError]":
        import torch

        from neural_strands.prior.errors import reconstruction_error
        from neural_strands.prior.refine import refine_latents

        with torch.no_grad():
            latent = prior.encode(strands)
            errors = {
                "prior": reconstruction_error(prior.decode(latent), strands),
                "pca": reconstruction_error(pca.decode(pca.encode(strands)), strands),
            }
        if self.optimise_steps:
            every = max(1, len(strands) // self.optimise_strands)
            some = strands[::every]
            better = refine_latents(prior.generator, latent[::every], some, self.optimise_steps)
            errors["optimised"] = reconstruction_error(prior.decode(better), some)
        return errors


def _names(paths: tuple[Path, ...]) -> list[str]:
    """Names of files or folders; full paths where the names are ambiguous."""
    names = [path.resolve().name for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def _panels(prior: "StrandPrior", strands: "Tensor") -> "list[Panel]":
    """The two worst, three median and the two best strands, true and decoded."""
    from neural_strands.pictures.plots import Panel
    from neural_strands.prior.errors import strand_errors

    decoded = prior.decode(prior.encode(strands))
    error = strand_errors(decoded, strands)
    order = error.argsort(descending=True).tolist()
    middle = len(order) // 2
    chosen = order[:2] + order[middle : middle + 3] + order[-2:]
    return [Panel((strands[i], decoded[i]), f"{float(error[i]):.3f} mm") for i in chosen]


def _table(title: str, errors: "dict[str, ReconstructionError]") -> str:
    """Rows of figures for the terminal."""
    titles = f"{'strands':>9}{'mean mm':>9}{'median':>8}{'p95':>8}{'dir °':>8}{'len %':>8}{'curv 1/m':>10}"
    rows = [
        f"  {name:10}{e.strands:9d}{e.mean_mm:9.3f}{e.median_mm:8.3f}{e.p95_mm:8.3f}{e.direction_deg:8.2f}"
        f"{e.length_percent:8.3f}{e.curvature_per_m:10.2f}\n"
        for name, e in errors.items()
    ]
    return f"{title}\n{'':12}{titles}\n" + "".join(rows)
