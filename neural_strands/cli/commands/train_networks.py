"""`neural-strands train-networks`: train the networks from which fits start."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.cli.streams import print_json, say
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import Feedback, track


@dataclass(frozen=True)
class TrainNetworks:
    """Train the image generator and the point shader from which `fit` starts, by fits of several captures in turn.

    Each fit starts from the networks of the one before. The fits stay beside OUT, in the folder OUT_fits (without the
    suffix), so that a stopped training continues when the same command is given again.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """Where to write the weights (.safetensors), for `fit --networks`."""
    captures: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of the captures, in the order of training: of many kinds of hair, if the networks shall serve all."""
    preset: Literal["demo", "fast", "paper"] = "fast"
    """Preset that determines the sizes of the networks; only fits of the same sizes can start from them."""
    steps: Annotated[int, Between(1, 10_000_000)] = 600
    """Steps of each fit."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Seed of all random numbers."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object instead of a sentence."""

    def run(self) -> None:
        """Fit the captures in turn and write the networks of the last fit."""
        from neural_strands.fitting.config import preset
        from neural_strands.runs.train_networks import train_networks

        if self.out.suffix != ".safetensors":
            raise InputError(f"{self.out}: expected a name that ends in .safetensors; give such a name.")
        if not self.captures:
            raise InputError("captures: expected folders of captures, found none; name at least one.")
        config = replace(preset(self.preset), steps=self.steps, seed=self.seed)
        train_networks(self.out, self.captures, config, pick_device(self.device), Feedback(say, track))
        if self.json:
            print_json({"weights": str(self.out), "captures": len(self.captures)})
        else:
            sys.stdout.write(f"{self.out}: networks trained on {len(self.captures)} captures\n")
