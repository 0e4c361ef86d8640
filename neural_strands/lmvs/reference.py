"""Plain torch versions of the kernels' functions, short and slow, against which tests check the kernels."""

import math
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor


def line_cost_reference(
    texture: Float[Tensor, "view height width 4"],
    projection: Float[Tensor, "view 4 4"],
    point: Float[Tensor, "line 3"],
    direction: Float[Tensor, "line 3"],
    normal: Float[Tensor, "line 3"],
    footprint: Float[Tensor, " line"],
    patch: Any,
) -> Float[Tensor, " line"]:
    """Cost of lines, like `lmvs.kernels.ribbons.line_cost`; `patch` is a `Patch`."""
    origin, motion = _seen(projection[0], point, 1.0), _seen(projection[0], direction, 0.0)
    speed = (motion[:, :2] * origin[:, 2:] - origin[:, :2] * motion[:, 2:]).norm(dim=-1) / origin[:, 2] ** 2
    along = direction * (patch.step * torch.minimum(1 / speed.clamp(min=1e-9), 2 * footprint))[:, None]
    across = torch.nn.functional.normalize(torch.linalg.cross(normal, direction), dim=-1)
    across = across * (patch.step * footprint)[:, None]
    steps_a = torch.arange(-patch.along, patch.along + 1)
    steps_b = torch.arange(-patch.across, patch.across + 1)
    offset = torch.cartesian_prod(steps_a, steps_b).to(point)
    sample = point[:, None] + offset[:, :1] * along[:, None] + offset[:, 1:] * across[:, None]
    geometric, brightness, inside = [], [], []
    for view in range(patch.views + 1):
        value, seen = _sample(texture[view], projection[view], sample)
        line = _doubled(_seen(projection[view], point, 1.0), _seen(projection[view], direction, 0.0))
        weight = value[..., 2].sum(1)
        cost = 0.5 * (value[..., 2] - (value[..., :2] * line[:, None]).sum(-1)).sum(1)
        least = 1e-4 if view == 0 else 1e-3 * len(offset)
        flat = torch.zeros_like(cost) if view == 0 else torch.full_like(cost, 0.5)
        geometric.append(torch.where(weight > least, cost / weight.clamp(min=1e-4), flat))
        brightness.append(value[..., 3])
        inside.append(seen.all(dim=1))
    costs = []
    first = brightness[0] - brightness[0].mean(1, keepdim=True)
    for view in range(1, patch.views + 1):
        other = brightness[view] - brightness[view].mean(1, keepdim=True)
        variance = [(one**2).mean(1).clamp(min=1e-7) for one in (first, other)]
        ncc = ((first * other).mean(1) / (variance[0] * variance[1]).sqrt()).clamp(-1, 1)
        cost = (1 - patch.intensity) * geometric[view] + patch.intensity * 0.5 * (1 - ncc)
        costs.append(torch.where(inside[view], cost, 1.0))
    best = torch.stack(costs).sort(dim=0).values[: patch.best].clamp(max=1).sum(0)
    share = 1 - patch.intensity
    return (best + share * geometric[0]) / (patch.best + share)


def mean_line_reference(
    points: Float[Tensor, "point 3"],
    directions: Float[Tensor, "point 3"],
    weights: Float[Tensor, " point"],
    place: Float[Tensor, "3"],
    direction: Float[Tensor, "3"],
    radius: float,
    degrees: float,
) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"], float]:
    """Shifted position, mean direction and weight around it, like `lmvs.kernels.chains.mean_line`."""
    offset = points - place
    square = (offset**2).sum(-1)
    cosine = directions @ direction
    near = (square < radius**2) & (cosine.abs() > math.cos(math.radians(degrees)))
    weight = torch.where(near, weights * torch.exp(-square / (0.5 * radius**2)), 0.0)
    total = float(weight.sum())
    if total == 0:
        return place, direction, 0.0
    across = offset - (offset @ direction)[:, None] * direction
    turned = (directions * (torch.sign(cosine) * weight)[:, None]).sum(0)
    moved = place + (across * weight[:, None]).sum(0) / total
    return moved, torch.nn.functional.normalize(turned, dim=0), total


def _seen(projection: Tensor, point: Tensor, weight: float) -> Tensor:
    """Homogeneous pixels of points (weight 1) or directions (weight 0)."""
    return point @ projection[:3, :3].T + weight * projection[:3, 3]


def _doubled(image: Tensor, motion: Tensor) -> Float[Tensor, "line 2"]:
    """Cosine and sine of twice the image angle of a line."""
    x, y = (motion[:, axis] * image[:, 2] - image[:, axis] * motion[:, 2] for axis in (0, 1))
    angle = 2 * torch.atan2(y, x)
    return torch.stack([torch.cos(angle), torch.sin(angle)], dim=-1)


def _sample(texture: Tensor, projection: Tensor, sample: Tensor) -> tuple[Tensor, Tensor]:
    """Bilinear values at the projections of points, and whether the view sees them."""
    height, width = texture.shape[:2]
    image = _seen(projection, sample, 1.0)
    pixel = image[..., :2] / image[..., 2:]
    size = pixel.new_tensor([width, height])
    seen = (image[..., 2] > 0) & (pixel > 0).all(-1) & (pixel < size).all(-1)
    place = torch.minimum((pixel - 0.5).clamp(min=0), size - 1.001)
    low = place.floor().long()
    part = place - low
    rows = []
    for step in (0, 1):
        left, right = (texture[low[..., 1] + step, low[..., 0] + shift] for shift in (0, 1))
        rows.append(left * (1 - part[..., :1]) + right * part[..., :1])
    return rows[0] * (1 - part[..., 1:]) + rows[1] * part[..., 1:], seen
