"""What lies behind each face of the voxels of a domain."""

import torch
from jaxtyping import Bool, Float, Int64, Shaped
from torch import Tensor


def face_neighbours(domain: Bool[Tensor, "x y z"]) -> Int64[Tensor, "cell 6"]:
    """The domain's voxel behind each face (see `behind_faces`) of its voxels, numbered; their count for none."""
    count = int(domain.sum())
    number = torch.full(domain.shape, count, device=domain.device)
    number[domain] = torch.arange(count, device=domain.device)
    return behind_faces(number, domain, count)


def behind_faces(
    values: Shaped[Tensor, "x y z"], domain: Bool[Tensor, "x y z"], beyond: int
) -> Shaped[Tensor, "cell 6"]:
    """Values of a volume behind each face (+x, +y, +z, -x, -y, -z) of the domain's voxels; `beyond` outside the box."""
    padded = torch.nn.functional.pad(values, (1, 1, 1, 1, 1, 1), value=beyond)
    offsets = torch.cat([torch.eye(3), -torch.eye(3)]).long().to(domain.device)
    behind = torch.nonzero(domain)[:, None] + 1 + offsets
    return padded[behind[..., 0], behind[..., 1], behind[..., 2]]


def neighbour_mean(
    values: Float[Tensor, "cell channel"], neighbours: Int64[Tensor, "cell 6"]
) -> Float[Tensor, "cell channel"]:
    """Mean over the cells behind each cell's faces (see `face_neighbours`); a cell without any keeps its own value."""
    count = (neighbours < len(values)).sum(dim=1, keepdim=True)
    padded = torch.cat([values, values.new_zeros(1, values.shape[1])])
    return torch.where(count > 0, padded[neighbours].sum(dim=1) / count.clamp(min=1), values)
