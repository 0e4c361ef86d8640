"""Seconds to synthesise 24 views of 256 x 256 at 16 samples a pixel of 10,000 wavy strands on the mannequin."""

import json
import sys
import tempfile
import time
from pathlib import Path

import torch

from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis.groom import make_groom
from neural_strands.synthesis.styles import MELANIN, STYLES
from neural_strands.synthesis.synthesize import SynthesisConfig, synthesize


def main() -> None:
    start, processor = time.perf_counter(), time.process_time()
    head = mannequin()
    groom = make_groom(head, STYLES["wavy"], MELANIN["brown"], 10_000, torch.Generator().manual_seed(0))
    grown = time.perf_counter() - start
    with tempfile.TemporaryDirectory() as folder:
        synthesize(Path(folder) / "capture", head, groom, SynthesisConfig(), {"style": "wavy"})
    figures = {
        "groom_seconds": round(grown, 1),
        "total_seconds": round(time.perf_counter() - start, 1),
        "processor_seconds": round(time.process_time() - processor, 1),
    }
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main()
