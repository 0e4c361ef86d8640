"""`neural-strands convert`: any groom format to any other, in metres, y up, +z front."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    from torch import Tensor

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


@dataclass(frozen=True)
class Convert:
    """Convert a groom into another format, in metres, y up, +z out of the face.

    --scale, --up and --front describe the input; with the defaults only the format changes. A USD file states its own
    unit and up axis, and is converted to metres, y up before these options apply.
    """

    input: Annotated[Path, tyro.conf.Positional]
    """Groom to read: .hair, .data, .tfx, .usd, .usda, .usdc, .ply, .obj or .npz."""
    output: Annotated[Path, tyro.conf.Positional]
    """Groom to write; its suffix chooses the format. An existing file is replaced."""
    scale: Annotated[float, Between(1e-6, 1e6)] = 1.0
    """Metres in one unit of the input: 0.01 for centimetres."""
    up: Axis = "y"
    """Axis of the input that points up; write --up=-z for a negative one."""
    front: Axis = "z"
    """Axis of the input that points out of the face."""
    points: Annotated[int, Between(2, 10_000)] | None = None
    """Points per strand, equally spaced along it. Default: the points stay as they are."""

    def run(self) -> None:
        """Read, rotate, scale, write."""
        from neural_strands.grooms.groom import Groom
        from neural_strands.grooms.io import check_suffix, read_groom, write_groom

        check_suffix(self.output)
        if self.up[-1] == self.front[-1]:
            raise InputError(f"--up {self.up} --front {self.front}: expected two different axes, such as y and z.")
        groom = read_groom(self.input)
        if self.points is not None:
            groom = Groom.from_strands(groom.strands(self.points))
        if (self.scale, self.up, self.front) != (1.0, "y", "z"):
            groom = groom.transformed(axes_to_world(self.up, self.front), self.scale)
        write_groom(self.output, groom)
        sys.stderr.write(f"{self.output}: {len(groom)} strands, {len(groom.vertices)} points.\n")


def axes_to_world(up: Axis, front: Axis) -> "Tensor":
    """Rotation whose rows are the input's right, up and front axes: it takes them to x, y and z."""
    import torch

    vectors = []
    for axis in (up, front):
        vector = torch.zeros(3)
        vector["xyz".index(axis[-1])] = -1.0 if axis.startswith("-") else 1.0
        vectors.append(vector)
    return torch.stack([torch.linalg.cross(*vectors), *vectors])
