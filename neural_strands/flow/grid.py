"""A box of cubic voxels in world metres."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64, Shaped
from torch import Tensor

from neural_strands.foundation.errors import InputError

MOST_VOXELS = 50_000_000


@dataclass(frozen=True)
class VoxelGrid:
    """Where the voxels lie.

    Attributes:
        origin: the box's lowest corner, metres.
        spacing: edge of a voxel, metres.
        shape: voxels along x, y, z.
    """

    origin: Float[Tensor, "3"]
    spacing: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, points: Float[Tensor, "point 3"], spacing: float, margin: float) -> "VoxelGrid":
        """The grid that holds `points` with `margin` metres on every side.

        Raises:
            InputError: the box would have more voxels than memory should hold.
        """
        low, high = points.amin(dim=0) - margin, points.amax(dim=0) + margin
        counts = ((high - low) / spacing).ceil().long().clamp(min=2)
        if int(counts.prod()) > MOST_VOXELS:
            extent = " x ".join(f"{value:.2f}" for value in (high - low).tolist())
            raise InputError(
                f"the hair spans {extent} m, expected a head's size in metres at {1000 * spacing:g} mm a voxel; "
                "check the capture's scale, or remove stray segments."
            )
        x, y, z = counts.tolist()
        return cls(low, spacing, (x, y, z))

    @property
    def count(self) -> int:
        """Number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    def centres(self) -> Float[Tensor, "x y z 3"]:
        """World positions of the voxels' centres."""
        axes = [
            (torch.arange(size, device=self.origin.device) + 0.5) * self.spacing + self.origin[axis]
            for axis, size in enumerate(self.shape)
        ]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)

    def index(self, points: Float[Tensor, "point 3"]) -> tuple[Int64[Tensor, " point"], Bool[Tensor, " point"]]:
        """Flat voxel index of each point (clamped to the box), and whether the point lies in the box."""
        cell = ((points - self.origin) / self.spacing).floor().long()
        size = torch.tensor(self.shape, device=points.device)
        inside = ((cell >= 0) & (cell < size)).all(dim=-1)
        cell = torch.minimum(cell.clamp(min=0), size - 1)
        return (cell[:, 0] * self.shape[1] + cell[:, 1]) * self.shape[2] + cell[:, 2], inside

    def sample(
        self, volume: Float[Tensor, "channel x y z"], points: Float[Tensor, "point 3"]
    ) -> Float[Tensor, "point channel"]:
        """Trilinear interpolation between the voxels' centres; the border's value outside."""
        size = torch.tensor(self.shape, device=points.device)
        unit = 2 * (points - self.origin) / (self.spacing * size) - 1
        grid = unit.flip(-1)[None, None, None]
        values = torch.nn.functional.grid_sample(volume[None], grid, padding_mode="border", align_corners=False)
        return values[0, :, 0, 0].T


def face_neighbours(domain: Bool[Tensor, "x y z"]) -> Int64[Tensor, "cell 6"]:
    """The domain's voxel behind each face (see `behind_faces`) of its voxels, numbered; their count for none."""
    count = int(domain.sum())
    number = torch.full(domain.shape, count, device=domain.device)
    number[domain] = torch.arange(count, device=domain.device)
    return behind_faces(number, domain, count)


def behind_faces(
    values: Shaped[Tensor, "x y z"], domain: Bool[Tensor, "x y z"], beyond: int
) -> Shaped[Tensor, "cell 6"]:
    """What a volume holds behind each face (+x, +y, +z, -x, -y, -z) of the domain's voxels; `beyond` past the box."""
    padded = torch.nn.functional.pad(values, (1, 1, 1, 1, 1, 1), value=beyond)
    offsets = torch.cat([torch.eye(3), -torch.eye(3)]).long().to(domain.device)
    behind = torch.nonzero(domain)[:, None] + 1 + offsets
    return padded[behind[..., 0], behind[..., 1], behind[..., 2]]
