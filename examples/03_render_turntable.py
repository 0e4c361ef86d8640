"""Render a run on a turntable: hair alone with its opacity, as PNG files.

python examples/03_render_turntable.py RUN PICTURES --frames 36
"""

from pathlib import Path

import tyro

import neural_strands as ns
from neural_strands.pictures.encoding import to_bytes, write_png


def main(run: Path, out: Path, /, frames: int = 36, size: int = 512, device: str = "cpu") -> None:
    """Render pictures.

    Args:
        run: folder of a fit, or of its model.
        out: folder of the pictures.
        frames: number of cameras on a circle around the hair.
        size: width and height, pixels.
        device: where to compute, such as cpu or cuda.
    """
    renderer = ns.HairRenderer.of(ns.load_model(run, device))
    for camera in ns.turntable_cameras(renderer.strands.points, frames, (size, size)):
        view = renderer.render(camera)
        write_png(out / f"{camera.name}.png", to_bytes(view.cutout))
    print(f"{out}: {frames} pictures")


if __name__ == "__main__":
    tyro.cli(main)
