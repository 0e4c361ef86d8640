"""Builds strands from steps and keeps them out of the head, by rotating steps so that lengths are preserved."""

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.kernels.outside import follow_outside as follow_kernel
from neural_strands.foundation import kernels
from neural_strands.geometry.distance_grid import SignedDistanceGrid

ROUNDS = 8
"""Largest number of rotations of a step until it ends outside."""
CLEARANCE = 0.001
"""Height above the skin that strands keep, metres, unless they were lower to begin with."""
LEAST = 0.0005
"""Height above the skin to which points that start lower are led, metres; more than the error of distances that are
interpolated between samples 2.5 mm apart, at ears for instance."""
LED_OUT = 1.0
"""Time after which no moving point is inside the body, seconds."""


def rest_clearance(
    points: Float[Tensor, "strand point 3"], body: SignedDistanceGrid | None
) -> Float[Tensor, "strand point"]:
    """Height above the body of every point at rest, at most `CLEARANCE`; negative where the fit left it inside."""
    return points.new_zeros(points.shape[:2]) if body is None else body(points).clamp(max=CLEARANCE)


def clearance_at(rest: Float[Tensor, "strand point"], seconds: float) -> Float[Tensor, "strand point"]:
    """Least height of every point at a time of the motion: points that start below `LEAST` are lifted gradually.

    Args:
        rest: result of `rest_clearance`.
        seconds: time since the hair was at rest.
    """
    share = min(max(seconds / LED_OUT, 0.0), 1.0)
    return torch.lerp(rest, rest.clamp(min=LEAST), share)


def follow_outside(
    roots: Float[Tensor, "strand 3"],
    steps: Float[Tensor, "strand segment 3"],
    body: SignedDistanceGrid | None,
    clearance: Float[Tensor, "strand point"],
) -> Float[Tensor, "strand point 3"]:
    """Follow `steps` from the roots, staying at least `clearance` above the body.

    Args:
        roots: world metres.
        steps: segments of the strands, from the root.
        body: signed distance to head and body; None for no obstacle.
        clearance: least height of each point, metres; the root's is not used.
    """
    if body is None:
        return torch.cat([roots[:, None], roots[:, None] + steps.cumsum(dim=1)], dim=1)
    points = torch.zeros(len(roots), steps.shape[1] + 1, 3, device=roots.device)
    points[:, 0] = roots
    inputs = [
        *body.grid.kernel_inputs(),
        kernels.array(body.values.float()),
        kernels.array(steps.float().contiguous(), wp.vec3),
        kernels.array(clearance.float().contiguous()),
        ROUNDS,
        kernels.array(points, wp.vec3),
    ]
    kernels.launch_split(follow_kernel, len(roots), inputs, roots.device)
    return points


def follow_outside_reference(
    roots: Float[Tensor, "strand 3"],
    steps: Float[Tensor, "strand segment 3"],
    body: SignedDistanceGrid,
    clearance: Float[Tensor, "strand point"],
) -> Float[Tensor, "strand point 3"]:
    """`follow_outside` in plain torch, for tests."""
    points = [roots]
    for k in range(steps.shape[1]):
        length = steps[:, k].norm(dim=-1, keepdim=True)
        target = points[-1] + steps[:, k]
        for _ in range(ROUNDS):
            distance, outward = body.with_outward(target)
            missing = (clearance[:, k + 1] - distance)[:, None]
            step = target - points[-1]
            up = (step * outward).sum(dim=-1, keepdim=True)
            flat = torch.nn.functional.normalize(step - up * outward, dim=-1)
            up = torch.minimum(up + missing, length)
            raised = up * outward + (length.square() - up.square()).clamp(min=0.0).sqrt() * flat
            target = torch.where(missing > 0, points[-1] + raised, target)
        points.append(target)
    return torch.stack(points, dim=1)
