"""3D Gaussian splats: the files that programs export, and the pictures that they make (Kerbl et al. 2023).

Pictures follow the rules that splats are trained with, or they would not show what was trained: each splat becomes a
Gaussian on the image plane by the projection's derivative at its centre (EWA, Zwicker et al. 2001), widened by a
variance of 0.3 pixels; nearer splats are blended over farther ones; colours are encoded (sRGB), not linear light.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.input_files import read_bytes
from neural_strands.geometry.cameras import Camera, quaternion_to_matrix

BLUR = 0.3
"""Variance that is added to every splat on the image plane, square pixels."""
REACH = 3.0
"""Standard deviations along x and y beyond which a splat is not drawn, but for SLACK pixels."""
SLACK = 2
LEAST_ALPHA = 1 / 255
"""Opacity below which a splat does not affect a pixel."""
MOST_ALPHA = 0.999
LEAST_LIGHT = 1e-4
"""A splat that would let less light than this through ends its pixel, and is not drawn there."""
WIDEST = 1.3
"""The projection's derivative is taken no farther off the axis than this, in half pictures."""
NEAR = 0.01
"""Depth from which splats are drawn, metres."""
TILE = 16
"""Side of the squares that are drawn at once, pixels."""
HEADER_END = b"end_header\n"


@dataclass(frozen=True)
class Splats:
    """A scene of splats.

    Attributes:
        means: world metres.
        scales: standard deviations along each splat's own axes, metres.
        quaternions: (w, x, y, z) of the rotation from those axes to the world, of any length.
        opacities: in [0, 1].
        harmonics: coefficients of the colour by viewing direction, (degree + 1)^2 of them; 0 is grey.
    """

    means: Float[Tensor, "splat 3"]
    scales: Float[Tensor, "splat 3"]
    quaternions: Float[Tensor, "splat 4"]
    opacities: Float[Tensor, " splat"]
    harmonics: Float[Tensor, "splat basis 3"]

    def __len__(self) -> int:
        return len(self.means)

    def covariances(self) -> Float[Tensor, "splat 3 3"]:
        """In the world's axes, square metres."""
        rotation = torch.vmap(quaternion_to_matrix)(self.quaternions)
        axes = rotation * self.scales[:, None, :]
        return axes @ axes.mT


@dataclass(frozen=True)
class SplatPicture:
    """An image of splats without a background.

    Attributes:
        colour: encoded (sRGB), multiplied by the opacity.
        alpha: opacity.
    """

    colour: Float[Tensor, "height width 3"]
    alpha: Float[Tensor, "height width"]


def read_splats(path: Path) -> Splats:
    """Read the PLY that splat programs export: binary, little-endian, floats alone, the layout of the paper's authors.

    Raises:
        InputError: the file is missing, or is not such a PLY.
    """
    data = read_bytes(path, "splats")
    end = data.find(HEADER_END)
    header = data[: max(end, 0)].decode("ascii", errors="replace")
    count = re.search(r"^element vertex (\d{1,9})$", header, re.MULTILINE)
    names = re.findall(r"^property float (\S+)$", header, re.MULTILINE)
    rest = sum(name.startswith("f_rest_") for name in names)
    parts = (("scale", 3), ("rot", 4), ("f_dc", 3))
    wanted = ["x", "y", "z", "opacity", *(f"{kind}_{k}" for kind, number in parts for k in range(number))]
    if count is None or "format binary_little_endian" not in header or not set(wanted) <= set(names) or rest % 3:
        raise InputError(f"{path}: expected the binary PLY of a splat program, found another file; export it again.")
    body = np.frombuffer(data, np.float32, offset=end + len(HEADER_END))
    if body.size != int(count[1]) * len(names) or not np.isfinite(body).all():
        raise InputError(
            f"{path}: expected {count[1]} splats of {len(names)} finite numbers, found {body.size} numbers; "
            "export it again."
        )
    table = torch.from_numpy(body.reshape(int(count[1]), len(names)).copy())

    def columns(kind: str, number: int) -> Tensor:
        return table[:, [names.index(f"{kind}_{k}") for k in range(number)]]

    return Splats(
        table[:, [names.index(axis) for axis in "xyz"]],
        columns("scale", 3).exp(),
        columns("rot", 4),
        table[:, names.index("opacity")].sigmoid(),
        # One colour's coefficients after the other's.
        torch.cat([columns("f_dc", 3)[:, None], columns("f_rest", rest).reshape(len(table), 3, rest // 3).mT], dim=1),
    )


def spherical_harmonics(directions: Float[Tensor, "splat 3"], count: int) -> Float[Tensor, "splat basis"]:
    """Real spherical harmonics of unit directions up to the third degree, in the order and with the signs of splats.

    Args:
        directions: unit vectors.
        count: how many: 1, 4, 9 or 16.
    """
    x, y, z = directions.unbind(-1)
    root = [math.sqrt(k / math.pi) for k in range(106)]
    basis = [
        torch.full_like(x, root[1] / 2),
        -root[3] / 2 * y,
        root[3] / 2 * z,
        -root[3] / 2 * x,
        root[15] / 2 * x * y,
        -root[15] / 2 * y * z,
        root[5] / 4 * (2 * z * z - x * x - y * y),
        -root[15] / 2 * x * z,
        root[15] / 4 * (x * x - y * y),
        -root[35] / math.sqrt(32) * y * (3 * x * x - y * y),
        root[105] / 2 * x * y * z,
        -root[21] / math.sqrt(32) * y * (4 * z * z - x * x - y * y),
        root[7] / 4 * z * (2 * z * z - 3 * x * x - 3 * y * y),
        -root[21] / math.sqrt(32) * x * (4 * z * z - x * x - y * y),
        root[105] / 4 * z * (x * x - y * y),
        -root[35] / math.sqrt(32) * x * (x * x - 3 * y * y),
    ]
    return torch.stack(basis[:count], dim=-1)


@torch.no_grad()
def render_splats(splats: Splats, camera: Camera) -> SplatPicture:
    """Draw the splats as a camera sees them."""
    flat = _Flat.of(splats, camera)
    colour = torch.zeros(camera.height, camera.width, 3)
    alpha = torch.zeros(camera.height, camera.width)
    for rows, columns, chosen in _tiles(flat, camera):
        y, x = (torch.arange(part.start, part.stop) + 0.5 for part in (rows, columns))
        part, covered = _blend(flat, chosen, x.repeat(len(y)), y.repeat_interleave(len(x)))
        colour[rows, columns] = part.reshape(len(y), len(x), 3)
        alpha[rows, columns] = covered.reshape(len(y), len(x))
    return SplatPicture(colour, alpha)


@dataclass(frozen=True)
class _Flat:
    """Splats on the image plane, nearest first.

    Attributes:
        centres: pixels.
        precisions: xx, xy and yy of the inverse covariance.
        first: of the columns and rows that a splat may touch.
        last: one beyond them.
        opacities: at the centre.
        colours: encoded, from this camera.
    """

    centres: Float[Tensor, "splat 2"]
    precisions: Float[Tensor, "splat 3"]
    first: Int64[Tensor, "splat 2"]
    last: Int64[Tensor, "splat 2"]
    opacities: Float[Tensor, " splat"]
    colours: Float[Tensor, "splat 3"]

    @classmethod
    def of(cls, splats: Splats, camera: Camera) -> "_Flat":
        depth = camera.transform(splats.means)[:, 2]
        order = depth.argsort(stable=True)
        order = order[depth[order] > NEAR]
        means = splats.means[order]
        centres, _ = camera.project(means)
        covariance = _image_covariance(camera.transform(means), splats.covariances()[order], camera)
        (xx, xy), (_, yy) = (row.unbind(-1) for row in covariance.unbind(-2))
        inverse = torch.stack([yy, -xy, xx], dim=-1) / (xx * yy - xy * xy)[:, None]
        reach = REACH * torch.stack([xx, yy], dim=-1).sqrt()
        # A pixel's index is its centre less a half.
        first = (centres - 0.5 - reach).floor().long() - SLACK
        last = (centres - 0.5 + reach).ceil().long() + SLACK
        directions = torch.nn.functional.normalize(means - camera.position, dim=-1)
        harmonics = splats.harmonics[order]
        colours = (spherical_harmonics(directions, harmonics.shape[1])[..., None] * harmonics).sum(dim=1) + 0.5
        return cls(centres, inverse, first, last, splats.opacities[order], colours.clamp(min=0))


def _image_covariance(
    in_camera: Float[Tensor, "splat 3"], covariance: Float[Tensor, "splat 3 3"], camera: Camera
) -> Float[Tensor, "splat 2 2"]:
    """Covariances on the image plane, square pixels, by the projection's derivative at each centre."""
    fx, fy = camera.intrinsics[0, 0], camera.intrinsics[1, 1]
    z = in_camera[:, 2]
    limits = WIDEST * torch.stack([0.5 * camera.width / fx, 0.5 * camera.height / fy])
    x, y = (in_camera[:, :2] / z[:, None]).clamp(-limits, limits).unbind(-1)
    zero = torch.zeros_like(z)
    rows = [torch.stack([fx / z, zero, -fx * x / z], dim=-1), torch.stack([zero, fy / z, -fy * y / z], dim=-1)]
    derivative = torch.stack(rows, dim=-2) @ camera.rotation
    return derivative @ covariance @ derivative.mT + BLUR * torch.eye(2)


def _tiles(flat: _Flat, camera: Camera) -> Iterator[tuple[slice, slice, Int64[Tensor, " chosen"]]]:
    """Squares of the picture, each with the splats that may touch it, nearest first."""
    for top in range(0, camera.height, TILE):
        rows = slice(top, min(top + TILE, camera.height))
        across = torch.nonzero((flat.first[:, 1] < rows.stop) & (flat.last[:, 1] > rows.start))[:, 0]
        first, last = flat.first[across, 0], flat.last[across, 0]
        for left in range(0, camera.width, TILE):
            columns = slice(left, min(left + TILE, camera.width))
            chosen = across[(first < columns.stop) & (last > columns.start)]
            if len(chosen):
                yield rows, columns, chosen


def _blend(
    flat: _Flat, chosen: Int64[Tensor, " chosen"], x: Float[Tensor, " pixel"], y: Float[Tensor, " pixel"]
) -> tuple[Float[Tensor, "pixel 3"], Float[Tensor, " pixel"]]:
    """Colour, multiplied by opacity, and opacity of pixels, from the splats that may touch them."""
    dx, dy = (flat.centres[chosen, None, axis] - place for axis, place in enumerate((x, y)))
    xx, xy, yy = flat.precisions[chosen].T[..., None]
    alpha = flat.opacities[chosen, None] * torch.exp(-0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy)
    (left, top), (right, bottom) = flat.first[chosen].T[..., None], flat.last[chosen].T[..., None]
    inside = (x > left) & (x < right) & (y > top) & (y < bottom)
    alpha = torch.where(inside & (alpha >= LEAST_ALPHA), alpha.clamp(max=MOST_ALPHA), 0.0)
    light = (1 - alpha).cumprod(dim=0)
    drawn = light > LEAST_LIGHT
    before = torch.cat([torch.ones_like(light[:1]), light[:-1]])
    weight = torch.where(drawn, alpha * before, 0.0)
    return weight.T @ flat.colours[chosen], weight.sum(dim=0)
