"""Speed of cutting, exporting and wind: wall and processor seconds, and the size of the export.

    python benchmarks/speed/edit.py

The hair is that of benchmarks/speed/render.py: strands of the shipped generator on a hemisphere of 9 cm. A cut counts
with the first frame of 512 x 512 that shows it; the light of the fitted hair, which the page works out in advance,
counts by itself. USD is written once with the colours that the groom has already, and once as `export` does it, with
guides and with colours rendered from all sides. Wind counts with everything that is prepared before its first frame.
Prints one JSON object.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import tyro
from render import Arguments as Rendering
from render import hair_model, view

from neural_strands.editing.edit_list import apply_edits, hair_motion
from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import Haircut, Wind
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.scenes.alembic import Blender
from neural_strands.grooms.scenes.scene import Scene, write_scene
from neural_strands.model.renderer import HairRenderer
from neural_strands.runs.edited import EditedHair
from neural_strands.runs.export import ExportConfig, export_hair


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    strands: int = 30_000
    """Number of strands that are cut and exported."""
    blown: int = 10_000
    """Strands in the wind."""
    frames: int = 100
    """Frames of wind."""


def seconds(run: Callable[[], object]) -> dict[str, float]:
    """Wall and processor seconds of one run."""
    wall, processor = time.perf_counter(), time.process_time()
    run()
    return {"wall_s": round(time.perf_counter() - wall, 2), "cpu_s": round(time.process_time() - processor, 2)}


def main(arguments: Arguments) -> None:
    """Measure and print."""
    keep_freed_memory()
    model = hair_model(arguments.strands, Rendering(), torch.device("cpu"))
    hair = Hair.of(model)
    camera = view(model, 512)
    cut = Haircut(length=0.15)
    renderer = HairRenderer.of(model, hair.strands)
    renderer.render(camera)
    figures: dict[str, object] = {
        "light_of_the_fitted_hair": seconds(renderer.prepare_edits),
        "cut": seconds(lambda: apply_edits(hair, [cut])),
        "cut_and_first_frame": seconds(lambda: renderer.showing(apply_edits(hair, [cut]).strands).render(camera)),
    }
    color = torch.rand(len(hair.strands), 3, generator=torch.Generator().manual_seed(0))
    groom = Groom.from_strands(replace(hair.strands, color=color))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hair.usd"
        figures["usd"] = {
            **seconds(lambda: write_scene(path, Scene(groom), Blender())),
            "megabytes": round(path.stat().st_size / 1e6, 1),
        }
        opened = EditedHair(path, hair, (), hair)
        figures["export"] = seconds(lambda: export_hair(opened, path, ExportConfig(), Blender()))
    few = replace(hair, strands=hair.strands.select(torch.arange(arguments.blown)))
    wind = Wind(seconds=arguments.frames / 24, fps=24.0)

    def blow() -> None:
        motion = hair_motion(few, [wind])
        assert motion is not None
        for frame in range(wind.frames):
            motion.at(frame / wind.fps)

    figures["wind"] = seconds(blow)
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
