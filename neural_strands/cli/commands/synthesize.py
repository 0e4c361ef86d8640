"""`neural-strands synthesize`: a capture with ground truth, from a procedural groom or one of your own."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from neural_strands.cli.device import seeded
from neural_strands.cli.streams import print_json
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    from neural_strands.geometry.strands import Strands
    from neural_strands.scalp.head import Head


@dataclass(frozen=True)
class Synthesize:
    """Render a synthetic capture: hair on a head, seen by a dome of cameras, with masks and ground truth.

    A stopped run continues when the same command is given again.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """Folder for the capture: new, empty, or begun by the same command."""
    style: Literal["short", "straight", "wavy", "curly"] = "wavy"
    """Style of the procedural groom."""
    colour: Literal["black", "brown", "auburn", "blond", "grey"] = "brown"
    """Pigment of the hair."""
    strands: int = 10_000
    """Strands of the procedural groom (100 to 1,000,000)."""
    groom: Path | None = None
    """Your own groom instead (any format of `convert`, metres, y up); needs --head."""
    head: Path | None = None
    """The head mesh (y up, +z out of the face; its unit is guessed). Default: the built-in mannequin."""
    scalp: Path | None = None
    """Where hair grows on --head: a chart, a face or vertex list, or a mask image. Default: scalp_faces.json beside the
    mesh; without that, the scalp is found from the shape."""
    views: Annotated[int, Between(1, 100_000)] = 24
    """Number of cameras."""
    resolution: Annotated[int, Between(8, 8192)] = 256
    """Width and height of the pictures (pixels)."""
    distance: float = 1.0
    """Distance of the cameras from the middle of the hair (m)."""
    elevation_min: float = -25.0
    """Lowest camera (degrees above the horizontal)."""
    elevation_max: float = 75.0
    """Highest camera (degrees above the horizontal)."""
    samples: Annotated[int, Between(1, 65_536)] = 16
    """Light paths per pixel; noise falls with the square root of their number."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Seed of all random numbers."""
    overwrite: bool = False
    """Replace a capture in OUT that was made with other settings."""
    shipped: bool = False
    """Take the pictures that ship with the package instead of rendering them, if they show this capture; only the
    demo's do."""
    json: bool = False
    """Print one JSON object instead of a sentence."""

    def run(self) -> None:
        """Grow or read the groom, then render the missing views."""
        from neural_strands.synthesis.dome import DomeConfig
        from neural_strands.synthesis.path_tracer import TracingConfig
        from neural_strands.synthesis.styles import MELANIN
        from neural_strands.synthesis.synthesize import SynthesisConfig, synthesize

        head = self._head()
        groom, origin = self._strands(head)
        config = SynthesisConfig(
            DomeConfig(self.views, self.resolution, self.distance, self.elevation_min, self.elevation_max),
            TracingConfig(samples=self.samples, melanin=MELANIN[self.colour]),
            self.seed,
        )
        rendered = synthesize(self.out, head, groom, config, origin, self.overwrite, self.shipped)
        figures = {
            "folder": str(self.out),
            "strands": len(groom),
            "views": self.views,
            "rendered": rendered,
            "resolution": self.resolution,
        }
        sentence = (
            f"{self.out}: {self.views} views of {self.resolution} x {self.resolution} pixels, {len(groom):,} strands; "
            f"{rendered} views rendered now."
        )
        if self.json:
            print_json(figures)
        else:
            sys.stdout.write(f"{sentence}\n")

    def _head(self) -> "Head":
        from neural_strands.scalp.load import load_head
        from neural_strands.scalp.mannequin import mannequin

        if self.head is not None:
            return load_head(self.head, self.scalp)
        if self.groom is not None or self.scalp is not None:
            option = "groom" if self.groom is not None else "scalp"
            raise InputError(f"--{option}: expected --head with it, the mesh that it belongs to; pass --head MESH.")
        return mannequin()

    def _strands(self, head: "Head") -> tuple["Strands", dict[str, str | int]]:
        """The hair, and where it comes from."""
        from neural_strands.grooms.io import read_groom
        from neural_strands.synthesis.groom import make_groom
        from neural_strands.synthesis.styles import MELANIN, STYLES

        if self.groom is not None:
            return read_groom(self.groom).strands(), {"groom": self.groom.name}
        strands = make_groom(head, STYLES[self.style], MELANIN[self.colour], self.strands, seeded(self.seed))
        return strands, {"style": self.style, "strands": self.strands}
