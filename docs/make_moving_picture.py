"""Draw the README's moving picture: fitted hair in simulated wind, while the camera swings from side to side.

    python docs/make_moving_picture.py RUN

RUN is the run of `neural-strands demo`. The wind rises and falls within one swing of the camera, so that the picture
repeats without a jump.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro
from PIL import Image

from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.settings import Wind
from neural_strands.foundation.files import atomic_file
from neural_strands.foundation.progress import track
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model.renderer import HairRenderer
from neural_strands.runs.edited import open_hair

ROOT = Path(__file__).resolve().parents[1]
FRAMING = 1.3
"""Size of the visible region, in multiples of the fitted hair's."""
SWING = 70.0
"""Angle by which the camera swings to either side of the face, degrees."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    run: Annotated[Path, tyro.conf.Positional]
    """The run whose hair moves in the wind."""
    out: Path = ROOT / "docs" / "pictures" / "wind.webp"
    """The picture."""
    size: int = 280
    """Width and height, pixels."""
    fps: float = 12.0
    """Frames per second."""


def main(arguments: Arguments) -> None:
    """Simulate, render, write."""
    hair = open_hair(arguments.run).hair
    wind = Wind(direction=(1.0, 0.15, 0.3), strength=1.0, seconds=3.0, calm=3.0, fps=arguments.fps, simulate=True)
    motion = hair_motion(hair, [wind])
    assert motion is not None
    points, side = hair.strands.points, arguments.size
    middle = points.mean(dim=(0, 1))
    around = turntable_cameras(middle + FRAMING * (points - middle), 360, (side, side))
    turns = SWING * (2 * math.pi * torch.arange(wind.frames) / wind.frames).sin()
    cameras = [around[round(turn) % 360] for turn in turns.tolist()]
    renderer, frames = HairRenderer.of(hair.modelled("wind"), hair.strands), []
    for number, camera in enumerate(track(cameras, "rendering")):
        moved = replace(hair.strands, points=motion.at(number / wind.fps))
        rgb = renderer.showing(moved).render(camera).rgb
        frames.append(Image.fromarray((255 * rgb.clamp(0, 1)).round().to(torch.uint8).numpy().astype(np.uint8)))
    with atomic_file(arguments.out) as path, path.open("wb") as file:
        frames[0].save(
            file,
            format="WEBP",
            save_all=True,
            append_images=frames[1:],
            duration=round(1000 / wind.fps),
            loop=0,
            quality=85,
            method=6,
        )


if __name__ == "__main__":
    main(tyro.cli(Arguments))
