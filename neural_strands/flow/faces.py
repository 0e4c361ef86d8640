"""Neighbours of the voxels of a domain, across their faces."""

import torch
from jaxtyping import Bool, Float, Int64, Shaped
from torch import Tensor

from neural_strands.flow.kernels.faces import sum_kernel
from neural_strands.foundation import kernels


def face_neighbours(domain: Bool[Tensor, "x y z"]) -> Int64[Tensor, "cell 6"]:
    """Index, in the domain, of the voxel behind each face (see `behind_faces`); the voxel count if there is none."""
    count = int(domain.sum())
    number = torch.full(domain.shape, count, device=domain.device)
    number[domain] = torch.arange(count, device=domain.device)
    return behind_faces(number, domain, count).contiguous()


def behind_faces(
    values: Shaped[Tensor, "x y z"], domain: Bool[Tensor, "x y z"], beyond: int
) -> Shaped[Tensor, "cell 6"]:
    """Values of a volume behind each face (+x, +y, +z, -x, -y, -z) of the domain's voxels; `beyond` outside the box."""
    padded = torch.nn.functional.pad(values, (1, 1, 1, 1, 1, 1), value=beyond)
    offsets = torch.cat([torch.eye(3), -torch.eye(3)]).long().to(domain.device)
    behind = torch.nonzero(domain)[:, None] + 1 + offsets
    return padded[behind[..., 0], behind[..., 1], behind[..., 2]]


def neighbour_sum(
    values: Float[Tensor, "cell channel"], neighbours: Int64[Tensor, "cell 6"]
) -> Float[Tensor, "cell channel"]:
    """Sum over the cells behind each cell's faces (see `face_neighbours`); no gradient passes."""
    return _over_neighbours(values, neighbours, is_mean=False)


def neighbour_sum_reference(
    values: Float[Tensor, "cell channel"], neighbours: Int64[Tensor, "cell 6"]
) -> Float[Tensor, "cell channel"]:
    """`neighbour_sum` in plain torch, for tests."""
    return torch.cat([values, values.new_zeros(1, values.shape[1])])[neighbours].sum(dim=1)


def neighbour_mean(
    values: Float[Tensor, "cell channel"], neighbours: Int64[Tensor, "cell 6"]
) -> Float[Tensor, "cell channel"]:
    """Mean over the cells behind each cell's faces; a cell without any keeps its own value. No gradient passes."""
    return _over_neighbours(values, neighbours, is_mean=True)


def neighbour_mean_reference(
    values: Float[Tensor, "cell channel"], neighbours: Int64[Tensor, "cell 6"]
) -> Float[Tensor, "cell channel"]:
    """`neighbour_mean` in plain torch, for tests."""
    count = (neighbours < len(neighbours)).sum(dim=1, keepdim=True)
    return torch.where(count > 0, neighbour_sum_reference(values, neighbours) / count.clamp(min=1), values)


def _over_neighbours(values: Tensor, neighbours: Tensor, is_mean: bool) -> Tensor:
    if values.dtype != torch.float32:
        return (neighbour_mean_reference if is_mean else neighbour_sum_reference)(values, neighbours)
    padded = torch.cat([values, values.new_zeros(1, values.shape[1])])
    found = kernels.zeros(values.shape, torch.float32, values.device)
    inputs = [kernels.array(padded), kernels.array(neighbours), int(is_mean), kernels.array(found)]
    kernels.launch_split(sum_kernel, len(values), inputs, values.device)
    return found
