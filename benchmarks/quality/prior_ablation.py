"""The effect of each loss, start and modulation of the strand prior: errors of variants that are trained equally long.

    python benchmarks/quality/prior_ablation.py DATA OUT [--only NAME ...] [--steps 4000] [--our-steps 500]

All variants see the same curves (seed) for the same steps: names without a star change one thing in the paper's preset,
names with a star one thing in our default. DATA is as in prior_quality.py; some strands of each groom are used. A
variant that is finished in OUT is not trained again; a stopped one continues. Writes OUT/table.txt and OUT/table.json.
"""

import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro
from prior_quality import sets
from torch import Tensor

from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.strands import segments
from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.errors import angles, reconstruction_error
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.refine import refine_latents
from neural_strands.prior.synthesiser import SynthesiserConfig
from neural_strands.prior.vae import StrandPrior
from neural_strands.prior_training.config import PriorLossConfig, TrainPriorConfig, paper_preset
from neural_strands.prior_training.curve_stream import keyed_generator
from neural_strands.prior_training.losses import kl_divergence
from neural_strands.prior_training.train_prior import train_prior

HELD_OUT = 1000
"""Number of held-out curves."""
FINE = 397
"""Points of the held-out curves; every 4th makes the 100 that are encoded, every 12th the 34."""
CURVATURE = 1e-2
"""Weight of turns: 20 times that of directions, as in later work of the paper's first author."""
SAMPLES = 2000
"""Number of samples of N(0, I)."""
OPTIMISED = 100
"""Number of strands of each set whose latents are optimised."""
RATE = 0.05
"""Learning rate of the optimiser of latents."""


def variants(steps: int, our_steps: int) -> dict[str, TrainPriorConfig]:
    """All variants by name."""
    plain = TrainPriorConfig(steps=steps, batch=128, steps_a_chunk=128)
    amplitude = GeneratorConfig(synthesiser=SynthesiserConfig(modulation="amplitude"))
    positions = GeneratorConfig(synthesiser=SynthesiserConfig(output="position"))
    paper = paper_preset(plain)
    ours = replace(plain, steps=our_steps, sine_steps=our_steps)
    loss = PriorLossConfig
    whitened = {"start_curves": plain.start_curves, "sine_steps": 0}
    both = loss(curvature=CURVATURE, free_bits=0.25)
    return {
        "paper": paper,
        "L1 points": paper_preset(replace(plain, loss=loss(kind="absolute"))),
        "relative points": replace(paper, loss=replace(paper.loss, kind="relative")),
        "curvature": paper_preset(replace(plain, loss=loss(curvature=CURVATURE))),
        "free bits": paper_preset(replace(plain, loss=loss(free_bits=0.25))),
        "whitened start": replace(paper, **whitened),
        "curvature, free bits, whitened": replace(paper_preset(replace(plain, loss=both)), **whitened),
        "amplitude alone": paper_preset(replace(plain, generator=amplitude)),
        "positions": paper_preset(replace(plain, generator=positions)),
        "default*": ours,
        "squared (paper's data loss)*": replace(ours, loss=loss(kind="paper")),
        "L1 points*": replace(ours, loss=loss(kind="absolute")),
        "curvature*": replace(ours, loss=loss(curvature=CURVATURE)),
        "sines not trained*": replace(ours, sine_steps=0),
        "amplitude alone*": replace(ours, generator=amplitude),
        "positions*": replace(ours, generator=positions),
    }


def file_name(name: str) -> str:
    """The file name of a variant."""
    return "".join(letter if letter.isalnum() else "_" for letter in name.replace("*", " ours"))


def trained(name: str, config: TrainPriorConfig, out: Path) -> tuple[StrandPrior, float]:
    """The prior of a variant, and the duration of its training over all calls, seconds."""
    weights = out / f"{file_name(name)}.safetensors"
    going_on = weights.with_suffix(".checkpoint.pt").is_file()
    log = weights.with_suffix(".log.jsonl")
    if not going_on:
        log.unlink(missing_ok=True)
    before = json.loads(log.read_text().splitlines()[-1])["seconds"] if log.is_file() else 0.0
    start = time.perf_counter()
    prior = train_prior(weights, config, seed=0, resume=going_on).eval().requires_grad_(False)
    return prior, before + time.perf_counter() - start


def optimised(prior: StrandPrior, data: dict[str, Tensor], steps: int) -> dict[str, dict]:
    """Errors that the decoder alone reaches from each strand's encoding."""
    few = {name: some(strands, OPTIMISED) for name, strands in data.items()}
    strands = torch.cat(list(few.values()))
    decoded = prior.decode(refine_latents(prior.generator, prior.encode(strands), strands, steps, RATE))
    parts = decoded.split([len(each) for each in few.values()])
    return {
        name: asdict(reconstruction_error(part, true)) for (name, true), part in zip(few.items(), parts, strict=True)
    }


@torch.no_grad()
def figures(prior: StrandPrior, data: dict[str, Tensor], held_out: Tensor) -> dict[str, object]:
    """Errors on each set, at other numbers of points, and how samples of N(0, I) look."""
    curves = held_out[:, ::4].contiguous()
    latent = prior.encode(curves)
    mean, log_std = prior.encoder(curves)
    errors = {"held out": reconstruction_error(prior.decode(latent), curves)}
    errors |= {
        f"held out, {len(true[0])} points": reconstruction_error(prior.decode(latent, len(true[0])), true)
        for true in (held_out[:, ::12], held_out)
    }
    for name, strands in data.items():
        errors[name] = reconstruction_error(prior.decode(prior.encode(strands)), strands)
    samples = prior.decode(torch.randn(SAMPLES, latent.shape[1], generator=keyed_generator(0, 7)))
    return {
        "errors": {name: asdict(error) for name, error in errors.items()},
        "kl_nats": float(kl_divergence(mean, log_std)),
        "samples_turn_deg": turn(samples),
        "curves_turn_deg": turn(curves),
    }


def turn(strands: Tensor) -> float:
    """Mean angle between consecutive segments, degrees."""
    steps = segments(strands)
    return float(torch.rad2deg(angles(steps[:, :-1], steps[:, 1:])).mean())


def table(results: dict[str, dict], kind: str) -> str:
    """Mean point error (mm) and mean direction error (degrees) on each set, one line per variant."""
    sets_of = list(next(iter(results.values()))[kind])
    names = [f"{chr(ord('A') + index)}: {name}" for index, name in enumerate(sets_of)]
    wide = max(len(name) for name in results)
    head = "".join(f"{chr(ord('A') + index):>15}" for index in range(len(sets_of)))
    lines = [f"{kind}: mean mm / mean direction error in degrees; " + "; ".join(names)]
    lines.append(f"{'':{wide}}{head}{'KL nats':>9}{'turn °':>8}{'s':>6}")
    for name, result in results.items():
        cells = "".join(f"{e['mean_mm']:9.3f} /{e['direction_deg']:4.1f}" for e in result[kind].values())
        lines.append(
            f"{name:{wide}}{cells}{result['kl_nats']:9.1f}{result['samples_turn_deg']:8.2f}{result['seconds']:6.0f}"
        )
    turned = next(iter(results.values()))["curves_turn_deg"]
    lines.append(f"turn: of samples of N(0, I) from segment to segment; held-out curves {turned:.2f}")
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    data: Annotated[Path, tyro.conf.Positional]
    """Folder that holds grooms/."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    only: tuple[str, ...] = ()
    """Names of variants; all by default."""
    steps: int = 4000
    """Steps of the paper's preset, 128 curves each."""
    our_steps: int = 500
    """Steps of each stage of our default, 128 curves each."""
    optimise: int = 200
    """Steps by which latents are also optimised; 0 for none."""
    strands: int = 500
    """Largest number of strands used from each groom."""


def main(arguments: Arguments) -> None:
    arguments.out.mkdir(parents=True, exist_ok=True)
    chosen = variants(arguments.steps, arguments.our_steps)
    if unknown := set(arguments.only) - set(chosen):
        raise SystemExit(f"no such variant: {', '.join(sorted(unknown))}; there are {', '.join(chosen)}")
    data: dict[str, Tensor] = {}
    held_out = synthetic_curves(HELD_OUT, keyed_generator(0, 6), points=FINE)
    finished = {name: arguments.out / f"{file_name(name)}.json" for name in chosen}
    results = {name: json.loads(path.read_text()) for name, path in finished.items() if path.is_file()}
    for name, config in chosen.items():
        settings = {"config": asdict(config), "strands": arguments.strands, "optimise": arguments.optimise}
        described, stored = json.loads(json.dumps(settings)), results.get(name)
        if (stored and stored["described"] == described) or (arguments.only and name not in arguments.only):
            continue
        data = data or {key: some(strands, arguments.strands) for key, strands in sets(arguments.data).items()}
        prior, seconds = trained(name, config, arguments.out)
        if stored and stored["described"]["config"] == described["config"]:
            seconds = stored["seconds"]  # Finished variants are only measured again.
        results[name] = {"described": described, "seconds": seconds, **figures(prior, data, held_out)}
        if arguments.optimise:
            results[name]["optimised"] = optimised(prior, {"held out": held_out[:, ::4], **data}, arguments.optimise)
        with atomic_file(finished[name]) as temporary:
            temporary.write_text(json.dumps(results[name]))
    ordered = {name: results[name] for name in chosen if name in results}
    (arguments.out / "table.json").write_text(json.dumps(ordered, indent=1))
    text = table(ordered, "errors")
    again = {name: result for name, result in ordered.items() if "optimised" in result}
    text += "\n" + table(again, "optimised") if again else ""
    (arguments.out / "table.txt").write_text(text)
    print(text, end="")


def some(strands: Tensor, count: int) -> Tensor:
    """At most `count` strands, spread evenly over all."""
    return strands[:: -(-len(strands) // count)]


if __name__ == "__main__":
    main(tyro.cli(Arguments))
