"""Draw the pictures of edits: the hair as it was fitted and after an edit, side by side.

    python docs/make_edit_pictures.py RUN OTHER            # all, into docs/pictures
    python docs/make_edit_pictures.py RUN OTHER --only wind haircut

RUN is the run of `neural-strands demo`, OTHER one of other hair, for `blend` and `transfer`. All pictures share a
camera that sees the hair of RUN well. `edits.png` puts the four of the README side by side.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro

from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.settings import Blend, Density, Edit, Haircut, Restyle, Sample, Transfer, Wind
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.pictures.encoding import write_png
from neural_strands.runs.edited import EditedHair, open_hair

ROOT = Path(__file__).resolve().parents[1]
FRAMING = 1.25
"""Size of the visible region, in multiples of the fitted hair's."""
SMALLER = 0.8
"""Size of a picture in the README's row, relative to the others."""
FOR_README = ("haircut", "wind", "curl", "volume")
"""Edits shown beside the fitted hair in `edits.png`."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    run: Annotated[Path, tyro.conf.Positional]
    """The run whose hair is edited."""
    other: Annotated[Path, tyro.conf.Positional]
    """Another run."""
    out: Path = ROOT / "docs" / "pictures"
    """Folder of the pictures."""
    only: tuple[str, ...] = ()
    """Names of the pictures; all of them if empty."""
    size: int = 330
    """Width and height of one picture, pixels."""
    turn: float = 35.0
    """Azimuth of the camera, degrees from the front to the hair's left."""


def edits(other: Path) -> dict[str, tuple[list[Edit], float]]:
    """The edits of each picture, and the time of moving ones, seconds."""
    breeze = Wind(direction=(1.0, 0.15, 0.3), strength=1.0, simulate=True)
    return {
        "haircut": ([Haircut(plane=(0.0, -0.06, 0.0, 0.0, -1.0, 0.0))], 0.0),
        "density": ([Density(strands=1500)], 0.0),
        "curl": ([Restyle(curl=1.0)], 0.0),
        "wave": ([Restyle(wave=1.0)], 0.0),
        "volume": ([Restyle(volume=0.5)], 0.0),
        "blend": ([Blend(other=str(other), share=0.5)], 0.0),
        "transfer": ([Transfer(other=str(other))], 0.0),
        "sample": ([Sample(seed=1)], 0.0),
        "quick_wind": ([dataclasses.replace(breeze, simulate=False)], 1.5),
        "wind": ([breeze], 1.5),
    }


def camera_of(points: torch.Tensor, turn: float, size: int) -> Camera:
    """A turntable's camera at an angle, with space for hair in the wind."""
    middle = points.mean(dim=(0, 1))
    return turntable_cameras(middle + FRAMING * (points - middle), 360, (size, size))[round(turn) % 360]


def picture(fitted: EditedHair, wanted: list[Edit], moment: float, camera: Camera) -> torch.Tensor:
    """The hair after its edits."""
    edited = fitted.edited(wanted)
    renderer = edited.renderer("pictures")
    motion = hair_motion(edited.hair, wanted)
    if motion is not None:
        renderer = renderer.showing(dataclasses.replace(edited.hair.strands, points=motion.at(moment)))
    return renderer.render(camera).rgb


def smaller(image: torch.Tensor) -> torch.Tensor:
    """A picture of SMALLER times the size."""
    rows = image.permute(2, 0, 1)[None]
    return torch.nn.functional.interpolate(rows, scale_factor=SMALLER, mode="bilinear", antialias=True)[0].permute(
        1, 2, 0
    )


def main(arguments: Arguments) -> None:
    """Render and write."""
    fitted = open_hair(arguments.run)
    camera = camera_of(fitted.hair.strands.points, arguments.turn, arguments.size)
    before = picture(fitted, [], 0.0, camera)
    drawn: dict[str, torch.Tensor] = {}
    for name, (wanted, moment) in edits(arguments.other).items():
        if arguments.only and name not in arguments.only:
            continue
        drawn[name] = picture(fitted, wanted, moment, camera)
        write_png(arguments.out / f"edit_{name}.png", torch.cat([before, drawn[name]], dim=1))
    if all(name in drawn for name in FOR_README):
        row = torch.cat([before, *(drawn[name] for name in FOR_README)], dim=1)
        write_png(arguments.out / "edits.png", smaller(row))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
