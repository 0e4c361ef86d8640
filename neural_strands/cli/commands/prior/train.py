"""`neural-strands train-prior`: train the strand generator and its encoder."""

import math
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.cli.streams import print_json
from neural_strands.foundation.errors import InputError
from neural_strands.prior_training.config import TrainPriorConfig


@dataclass(frozen=True)
class TrainPrior:
    """Train the strand prior on synthetic curves, and on the strands of your own grooms if you give any.

    Writes OUT (safetensors), and beside it a checkpoint and a log (.checkpoint.pt, .log.jsonl). It can be interrupted
    at any time: --resume continues from the last checkpoint, with the same result as a run that was never stopped.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """Where to write the weights (.safetensors)."""
    preset: Literal["default", "paper"] = "default"
    """Ours, or the paper's: its modulator, encoder, losses and loss weights, and a random start; options of --config
    that differ from our defaults are kept."""
    minutes: float | None = None
    """Stop after this many minutes, finished or not; the results so far are kept."""
    resume: bool = False
    """Continue from the checkpoint beside OUT."""
    groom: tuple[Path, ...] = ()
    """Groom files, or captures with true strands, whose strands are added to the curves."""
    head: tuple[Path, ...] = ()
    """Head of each groom, in its frame and metres; scalp_faces.json beside it is used. Default: the capture's own, or
    the mannequin fitted to the roots."""
    seed: int = 0
    """Seed of all random numbers."""
    device: DeviceName = "auto"
    """Where to train."""
    json: bool = False
    """Print one JSON object with the held-out error."""
    config: TrainPriorConfig = field(default_factory=TrainPriorConfig)
    """Sizes, losses and steps."""

    def run(self) -> None:
        """Read the grooms, train, and report where the weights are."""
        import torch

        from neural_strands.prior_training.config import paper_preset
        from neural_strands.prior_training.groom_strands import local_strands
        from neural_strands.prior_training.train_prior import held_out_curves, held_out_error, train_prior

        if self.head and len(self.head) != len(self.groom):
            raise InputError(f"--head: expected one per groom ({len(self.groom)}), found {len(self.head)}.")
        if self.out.suffix != ".safetensors":
            raise InputError(f"{self.out}: expected a name that ends in .safetensors; give such a name.")
        if self.minutes is not None and not 0 <= self.minutes < math.inf:
            raise InputError(f"--minutes: expected a number of at least 0, found {self.minutes:g}.")
        config = paper_preset(self.config) if self.preset == "paper" else self.config
        heads = self.head or (None,) * len(self.groom)
        own = [local_strands(groom, head) for groom, head in zip(self.groom, heads, strict=True)]
        device = pick_device(self.device)
        data = "synthetic curves" + "".join(f", {path.name}" for path in self.groom)
        prior = train_prior(
            self.out,
            config,
            seed=self.seed,
            minutes=self.minutes,
            resume=self.resume,
            own=torch.cat(own) if own else None,
            device=device,
            notes={"made_by": f"neural-strands train-prior --preset {self.preset} --seed {self.seed}", "data": data},
        )
        error = held_out_error(prior, held_out_curves(self.seed, config.curves).to(device))
        if self.json:
            print_json({"weights": str(self.out), "held_out_mm": error})
        else:
            sys.stdout.write(f"{self.out}: held-out error {error:.3f} mm\n")
