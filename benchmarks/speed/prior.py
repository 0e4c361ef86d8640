"""Speed of the strand prior: decode, decode with gradients, encode, load; and how cost grows.

    python benchmarks/speed/prior.py [--device cpu] [--threads 2] [--json]

Prints the shortest of several runs (milliseconds), and the ratio of the cost of twice the strands or points. Then,
beside it in turn, the naive twin that adds up the sines of all units one by one, for all strands at once.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
import tyro
from beside import Beside, beside, beside_table

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.prior.vae import load_prior


def shortest(work: Callable[[], object], device: torch.device, repeats: int) -> float:
    """Milliseconds of the fastest of several runs, after a warm-up run."""
    times = []
    for _ in range(repeats + 1):
        if device.type == "cuda":
            torch.cuda.synchronize()
        start = time.perf_counter()
        work()
        if device.type == "cuda":
            torch.cuda.synchronize()
        times.append(1000 * (time.perf_counter() - start))
    return min(times[1:])


def measured(device: torch.device, strands: int, repeats: int) -> dict[str, float]:
    """All timings on one device."""
    prior = load_prior(device=device)
    bare = prior.without_modulator()
    latent = torch.randn(2 * strands, 64, generator=torch.Generator().manual_seed(0)).to(device)

    def decode(count: int, points: int = 100) -> None:
        with torch.no_grad():
            prior.decode(latent[:count], points)

    def backward(count: int) -> None:
        leaf = latent[:count].clone().requires_grad_(True)
        prior.decode(leaf).sum().backward()

    curves = prior.decode(latent[:strands] * 0.5)
    decoded = shortest(lambda: decode(strands), device, repeats)
    return {
        "load_ms": shortest(load_prior, device, repeats),
        "decode_ms": decoded,
        "decode_without_modulator_ms": shortest(lambda: bare.decode(latent[:strands]), device, repeats),
        "decode_and_backward_ms": shortest(lambda: backward(strands), device, repeats),
        "encode_ms": shortest(lambda: prior.encode(curves), device, repeats),
        "ratio_of_twice_the_strands": shortest(lambda: decode(2 * strands), device, repeats) / decoded,
        "ratio_of_twice_the_points": shortest(lambda: decode(strands, 199), device, repeats) / decoded,
    }


def twins(device: torch.device, strands: int, repeats: int) -> list[Beside]:
    """Decoding beside its naive twin."""
    prior = load_prior(device=device)
    generator, bare = prior.generator, prior.without_modulator().generator
    latent = torch.randn(strands, 64, generator=torch.Generator().manual_seed(0)).to(device)

    def backward(decode: Callable[[torch.Tensor], torch.Tensor]) -> None:
        decode(latent.clone().requires_grad_(True)).sum().backward()

    twin = "all at once, sine by sine"
    with torch.no_grad():
        rows = [
            beside(name, lambda: decoder(latent), (twin, lambda: decoder.reference(latent)), device, repeats)  # noqa: B023
            for name, decoder in (("decode", generator), ("decode without modulator", bare))
        ]
    both = (twin, lambda: backward(generator.reference))
    return [*rows, beside("decode and backward", lambda: backward(generator), both, device, repeats)]


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    device: DeviceName = "cpu"
    """Where to compute."""
    threads: int = 2
    """CPU threads."""
    strands: int | None = None
    """Strands; by default 10,000 on the CPU and 30,000 on CUDA."""
    repeats: int = 7
    """Runs of each figure."""
    json: bool = False
    """Print one JSON object."""


def main(arguments: Arguments) -> None:
    keep_freed_memory()  # as the command line does
    torch.set_num_threads(arguments.threads)
    device = pick_device(arguments.device)
    strands = arguments.strands or (10_000 if device.type == "cpu" else 30_000)
    figures = measured(device, strands, arguments.repeats)
    if arguments.json:
        print(json.dumps({"device": str(device), "strands": strands, **figures}))
        return
    for name, value in figures.items():
        print(f"{name:30} {value:9.2f}")
    print(f"\n{beside_table(twins(device, strands, arguments.repeats), device)}")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
