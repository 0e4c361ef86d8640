"""Orthonormal frames: tangent, bitangent and normal as the columns of a rotation from local to world."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import directions


def orthonormal_frames(
    normals: Float[Tensor, "*batch 3"], tangents: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3 3"]:
    """Frames whose columns are tangent, bitangent, normal; right-handed (T x B = N).

    The normal is kept and the tangent is made orthogonal to it (Gram-Schmidt). A tangent parallel to its normal, or
    zero, is replaced by the world axis least aligned with the normal.
    """
    normal = torch.nn.functional.normalize(normals, dim=-1)
    fallback = torch.nn.functional.one_hot(normal.abs().argmin(dim=-1), 3).to(normal)
    tangent = tangents - (tangents * normal).sum(-1, keepdim=True) * normal
    degenerate = tangent.norm(dim=-1, keepdim=True) < 1e-6 * tangents.norm(dim=-1, keepdim=True).clamp(min=1e-12)
    other = fallback - (fallback * normal).sum(-1, keepdim=True) * normal
    tangent = torch.nn.functional.normalize(torch.where(degenerate, other, tangent), dim=-1)
    bitangent = torch.linalg.cross(normal, tangent, dim=-1)
    return torch.stack([tangent, bitangent, normal], dim=-1)


def to_local(
    points: Float[Tensor, "strand point 3"],
    origins: Float[Tensor, "strand 3"],
    frames: Float[Tensor, "strand 3 3"],
) -> Float[Tensor, "strand point 3"]:
    """World points to each root's frame (coordinates along tangent, bitangent, normal; the origin at the root)."""
    return (points - origins[:, None]) @ frames


def to_world(
    points: Float[Tensor, "strand point 3"],
    origins: Float[Tensor, "strand 3"],
    frames: Float[Tensor, "strand 3 3"],
) -> Float[Tensor, "strand point 3"]:
    """Inverse of `to_local`."""
    # Many products of 3 x 3 with 3 x n take a quarter of the time of as many of n x 3 with 3 x 3.
    return torch.baddbmm(origins[:, :, None], frames, points.mT).mT.contiguous()


def strand_frames(
    points: Float[Tensor, "strand point 3"], normals: Float[Tensor, "strand 3"]
) -> Float[Tensor, "strand point 3 3"]:
    """Twist-free frames along each strand; columns are sideways, across, along."""
    along = directions(points)
    sideways = torch.linalg.cross(along[:, 0], normals, dim=-1)
    frames = []
    for index in range(points.shape[1]):
        frame = orthonormal_frames(along[:, index], sideways)
        sideways = frame[..., 0]
        frames.append(frame)
    return torch.stack(frames, dim=1)
