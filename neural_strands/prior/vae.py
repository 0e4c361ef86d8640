"""The strand prior: generator and encoder together, their file, and checks of strands to encode."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import torch
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from neural_strands.foundation.configs import config_from_json
from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.files import atomic_file
from neural_strands.foundation.json_files import parse_json
from neural_strands.foundation.tensor_files import safetensors_bytes
from neural_strands.geometry.resample import resample_strands
from neural_strands.geometry.strands import lengths
from neural_strands.prior.bounded_quantities import LONGEST, SHORTEST
from neural_strands.prior.encoder import EncoderConfig, StrandEncoder
from neural_strands.prior.generator import GeneratorConfig, StrandGenerator

SHIPPED = Path(__file__).parent / "weights" / "strand_prior.safetensors"
"""Weights that ship with the package."""
ADVICE = "train them again or reinstall"
BLOCK = 2048
"""Strands encoded together, to bound the memory of the analysis."""


class StrandPrior(nn.Module):
    """A variational autoencoder of strands in their roots' frames (metres, the root at 0)."""

    def __init__(self, generator: GeneratorConfig | None = None, encoder: EncoderConfig | None = None) -> None:
        super().__init__()
        self.generator = StrandGenerator(generator)
        self.encoder = StrandEncoder(self.generator, encoder)

    def forward(
        self, points: Float[Tensor, "strand point 3"], noise: Float[Tensor, "strand latent"]
    ) -> tuple[Float[Tensor, "strand point 3"], Float[Tensor, "strand latent"], Float[Tensor, "strand latent"]]:
        """Reconstruct from a sampled latent (mean + noise x deviation); also returns mean and log deviation."""
        mean, log_std = self.encoder(points)
        return self.generator(mean + noise * log_std.exp(), points.shape[1]), mean, log_std

    def without_modulator(self) -> "StrandPrior":
        """Return a prior of the same strands whose latents are the outputs of the coupling modulator.

        These latents also have zero mean and unit covariance over the training curves, decode faster and are better
        conditioned, which suits a fit. But samples of N(0, I) and interpolations between latents look less like hair.

        Raises:
            ValueError: the modulator is the paper's MLP.
        """
        if self.generator.config.modulator != "coupling":
            raise ValueError("only a coupling modulator can be left out")
        bare = StrandPrior(replace(self.generator.config, layers=0), self.encoder.config)
        kept = {name: value for name, value in self.state_dict().items() if "modulator" not in name}
        bare.load_state_dict(kept, strict=False)
        return bare.to(self.generator.linear.weight.device).eval().requires_grad_(False)

    @torch.no_grad()
    def encode(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand latent"]:
        """Encode strands in local metres to mean latents; they are moved to the root and resampled if necessary.

        Strands longer than those of training (0.6 m) are encoded at their own scale, up to `LONGEST`. Their latents are
        far from the origin: samples of N(0, I) hardly ever reach a metre.

        Raises:
            InputError: a strand has fewer than two points, is not finite, has no length, or is too long or too short.
        """
        check_strands(points)
        # Where points are not neighbours in memory, what follows takes twice as long.
        points = (points - points[:, :1]).contiguous()
        if points.shape[1] != self.encoder.config.points:
            points = resample_strands(points, self.encoder.config.points)
        if len(points) == 0:
            return points.new_zeros(0, self.generator.config.latent)
        return torch.cat([self.encoder(block)[0] for block in points.split(BLOCK)])

    def decode(self, latent: Float[Tensor, "strand latent"], points: int = 100) -> Float[Tensor, "strand {points} 3"]:
        """Decode latents to strands with any number of points, in local metres."""
        return self.generator(latent, points).contiguous()


def check_strands(points: Float[Tensor, "strand point 3"]) -> None:
    """Refuse strands that have no latent.

    Raises:
        InputError: there is such a strand; the message names the first.
    """
    if points.shape[1] < 2:
        raise InputError(f"strands to encode: expected at least two points each, found {points.shape[1]}; drop them.")
    broken = ~torch.isfinite(points).flatten(1).all(dim=1)
    if broken.any():
        raise InputError(
            f"strands to encode: {int(broken.sum())} of {len(points)} hold NaN or infinite coordinates "
            f"(the first is strand {int(broken.nonzero()[0])}); drop them."
        )
    length = lengths(points)
    outside = (length < SHORTEST) | (length > LONGEST)
    if outside.any():
        first = int(outside.nonzero()[0])
        raise InputError(
            f"strands to encode: {int(outside.sum())} of {len(points)} are shorter than {SHORTEST * 1000:g} mm or "
            f"longer than {LONGEST:g} m (strand {first} is {float(length[first]):.4g} m); check the unit or drop them."
        )


def save_prior(prior: StrandPrior, path: Path, notes: dict[str, str]) -> None:
    """Write weights and sizes as safetensors.

    Args:
        prior: the prior to save.
        path: the file.
        notes: how the weights were made (command, seed, data), stored with them.

    Raises:
        InputError: the file cannot be written.
    """
    described = {"generator": asdict(prior.generator.config), "encoder": asdict(prior.encoder.config)}
    tensors = {name: value.detach().cpu().contiguous() for name, value in prior.state_dict().items()}
    with atomic_file(path) as temporary:
        temporary.write_bytes(safetensors_bytes(tensors, {**notes, "config": json.dumps(described)}))


def load_prior(path: Path | None = None, device: torch.device | str = "cpu") -> StrandPrior:
    """Load weights (those shipped with the package by default), frozen and ready to use.

    Raises:
        InputError: the file is missing, damaged, or not a strand prior.
    """
    path = path or SHIPPED
    if not path.is_file():
        raise InputError(f"{path}: expected strand prior weights, found no file; train them with train-prior.")
    try:
        with safe_open(path, framework="pt", device=str(device)) as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise _broken(path, f"something else ({reason(error)})") from error
    if "config" not in metadata:
        raise _broken(path, "tensors without their sizes")
    if (name := next((n for n, v in tensors.items() if not v.isfinite().all()), None)) is not None:
        raise _broken(path, f"NaN or infinity in {name}")
    described = parse_json(metadata["config"], f"{path}: config", "the sizes of a prior", ADVICE)
    generator = config_from_json(GeneratorConfig, described.member("generator"))
    encoder = config_from_json(EncoderConfig, described.member("encoder"))
    try:
        prior = StrandPrior(generator, encoder)
        prior.load_state_dict(tensors)
    except (RuntimeError, ValueError, TypeError) as error:
        raise _broken(path, f"something else ({reason(error)})") from error
    return prior.to(device).eval().requires_grad_(False)


def _broken(path: Path, found: str) -> InputError:
    return InputError(f"{path}: expected the complete weights of a strand prior, found {found}; {ADVICE}.")
