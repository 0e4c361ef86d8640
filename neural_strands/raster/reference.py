"""Plain torch versions of the kernels, short and slow, against which tests check the kernels."""

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.raster.keys import background_keys, empty_keys, key_index, pack_keys
from neural_strands.raster.lines import DEFAULT_LINES, LineBuffer, LineConfig
from neural_strands.raster.triangles import NEAR

FACES_AT_ONCE = 256
"""Faces tested against all pixels at once."""


def splat_reference(
    pixels: Float[Tensor, "point 2"],
    features: Float[Tensor, "point channel"],
    size: tuple[int, int],
    scale: float,
    minimum_weight: float,
    amounts: Float[Tensor, " point"] | None = None,
) -> tuple[Float[Tensor, "cell channel"], Float[Tensor, " cell"]]:
    """One level of the splat: weighted means and sums of weights of every pixel, row by row; differentiable.

    Args:
        pixels: x and y in pixels of the full image.
        features: what each point carries.
        size: height and width of this level.
        scale: pixels of this level per pixel of the full image.
        minimum_weight: smallest divisor of the weighted mean.
        amounts: weight of each point, by default 1.
    """
    height, width = size
    amounts = torch.ones_like(pixels[:, 0]) if amounts is None else amounts
    sums = features.new_zeros(height * width, features.shape[1])
    weights = features.new_zeros(height * width)
    position = pixels * scale - 0.5
    corner = position.detach().floor()
    fraction = position - corner
    for down in (0, 1):
        for right in (0, 1):
            u, v = (corner[:, 0] + right).long(), (corner[:, 1] + down).long()
            weight_x = fraction[:, 0] if right else 1 - fraction[:, 0]
            weight_y = fraction[:, 1] if down else 1 - fraction[:, 1]
            inside = torch.nonzero((u >= 0) & (u < width) & (v >= 0) & (v < height)).squeeze(1)
            cell, weight = (v * width + u)[inside], (amounts * weight_x * weight_y)[inside]
            weights = weights.index_add(0, cell, weight)
            sums = sums.index_add(0, cell, weight[:, None] * features[inside])
    return sums / weights.clamp(min=minimum_weight)[:, None], weights


def rasterise_lines_reference(
    points: Float[Tensor, "strand point 3"],
    camera: Camera,
    occluder_depth: Float[Tensor, "height width"] | None = None,
    config: LineConfig = DEFAULT_LINES,
    t: Float[Tensor, "strand point"] | None = None,
) -> LineBuffer:
    """Twin of `lines.rasterise_lines`: list every pixel of every segment, then keep the nearest."""
    height, width = camera.height, camera.width
    keys = empty_keys(height, width, points.device)
    if occluder_depth is not None:
        keys = background_keys(occluder_depth + config.occluder_bias)
    in_camera = camera.transform(points.detach()) @ camera.intrinsics.T
    a, b = in_camera[:, :-1].reshape(-1, 3), in_camera[:, 1:].reshape(-1, 3)
    cut = ((config.near - a[:, 2]) / (b[:, 2] - a[:, 2])).nan_to_num(0.0)
    begin = torch.where(a[:, 2] > config.near, 0.0, cut)
    end = torch.where(b[:, 2] > config.near, 1.0, cut)
    lines = torch.stack([torch.lerp(a, b, begin[:, None]), torch.lerp(a, b, end[:, None])], dim=1)
    screen = torch.cat([lines[..., :2] / lines[..., 2:], 1 / lines[..., 2:]], dim=-1)
    drawn = ((a[:, 2] > config.near) | (b[:, 2] > config.near)) & screen.isfinite().all(-1).all(-1)
    index = torch.nonzero(drawn).squeeze(1)
    index, major, fraction = _pixels_along(screen, index, (width, height))
    crossing = torch.lerp(screen[index, 0], screen[index, 1], fraction[:, None])
    along_x = _along_x(screen)[index]
    minor = torch.where(along_x, crossing[:, 1], crossing[:, 0])
    even = torch.linspace(0, 1, points.shape[1], device=points.device).expand(points.shape[:2])
    listed, minor = _pixels_across(
        minor, _half_widths(screen, index, fraction, even if t is None else t, camera, config)
    )
    index, major, along_x, crossing = index[listed], major[listed], along_x[listed], crossing[listed]
    inside = (minor >= 0) & (minor < torch.where(along_x, height, width))
    row = torch.where(along_x, minor, major)[inside]
    column = torch.where(along_x, major, minor)[inside]
    key = pack_keys(1 / crossing[inside, 2], index[inside])
    keys = keys.view(-1).scatter_reduce(0, row * width + column, key, "amin").view(height, width)
    segment = key_index(keys)
    hit = segment >= 0
    pixel_y, pixel_x = torch.nonzero(hit).unbind(1)
    chosen = segment[hit]
    fraction = _fraction(screen[chosen], torch.where(_along_x(screen)[chosen], pixel_x, pixel_y))
    inverse = torch.lerp(screen[chosen, 0, 2], screen[chosen, 1, 2], fraction)
    along = fraction * screen[chosen, 1, 2] / inverse
    position = torch.zeros(height, width, device=points.device)
    position[hit] = torch.lerp(begin[chosen], end[chosen], along).clamp(0, 1).float()
    depth = torch.where(hit, (keys >> 32).int().view(torch.float32), torch.inf)
    return LineBuffer(segment, position, depth)


def _along_x(screen: Float[Tensor, "segment 2 3"]) -> Tensor:
    """Whether each projected segment is longer in x than in y."""
    step = (screen[:, 1] - screen[:, 0]).abs()
    return step[:, 0] >= step[:, 1]


def _fraction(screen: Float[Tensor, "n 2 3"], major: Int64[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Where projected segments cross the centre of a column (or row) along their major axis."""
    ends = torch.where(_along_x(screen)[:, None], screen[..., 0], screen[..., 1])
    return (major + 0.5 - ends[:, 0]) / (ends[:, 1] - ends[:, 0])


def _pixels_along(
    screen: Float[Tensor, "segment 2 3"], index: Int64[Tensor, " drawn"], size: tuple[int, int]
) -> tuple[Int64[Tensor, " n"], Int64[Tensor, " n"], Float[Tensor, " n"]]:
    """List the columns (or rows) whose centres segments cross: segment, column or row, fraction of the segment."""
    along_x = _along_x(screen)[index]
    ends = torch.where(along_x[:, None], screen[index, :, 0], screen[index, :, 1])
    limit = torch.where(along_x, *(torch.full_like(ends[:, 0], side) for side in size))
    start = (ends.amin(1).clamp(min=0) - 0.5).ceil().long()
    stop = (ends.amax(1).minimum(limit) - 0.5).ceil().long()
    count = (stop - start).clamp(min=0)
    listed = torch.repeat_interleave(torch.arange(len(index), device=index.device), count)
    first = (count.cumsum(0) - count)[listed]
    major = start[listed] + torch.arange(len(listed), device=index.device) - first
    return index[listed], major, _fraction(screen[index[listed]], major)


def _half_widths(
    screen: Float[Tensor, "segment 2 3"],
    index: Int64[Tensor, " n"],
    fraction: Float[Tensor, " n"],
    t: Float[Tensor, "strand point"],
    camera: Camera,
    config: LineConfig,
) -> Float[Tensor, " n"]:
    """Half the number of pixels that lines cover across their major axis, from LineConfig.width and tip."""
    if config.width <= 0:
        return torch.full_like(fraction, 0.5)
    step = (screen[index, 1, :2] - screen[index, 0, :2]).abs()
    stretch = step.norm(dim=1) / step.amax(dim=1)
    focal = (camera.intrinsics[0, 0] * camera.intrinsics[1, 1]).sqrt()
    ends = torch.stack([t[:, :-1].flatten(), t[:, 1:].flatten()], dim=1)[index]
    tip = (1 - ends) / config.tip if config.tip > 0 else torch.ones_like(ends)
    half = 0.5 * config.width * focal * screen[index, :, 2] * tip.clamp(max=1.0)
    return torch.lerp(half[:, 0], half[:, 1], fraction) * stretch


def _pixels_across(
    minor: Float[Tensor, " n"], half: Float[Tensor, " n"]
) -> tuple[Int64[Tensor, " m"], Int64[Tensor, " m"]]:
    """List the rows (or columns) whose centres lie within half a width of each crossing: crossing, row."""
    start, stop = (minor - half - 0.5).ceil().long(), (minor + half - 0.5).ceil().long()
    count = (stop - start).clamp(min=0)
    listed = torch.repeat_interleave(torch.arange(len(minor), device=minor.device), count)
    first = (count.cumsum(0) - count)[listed]
    return listed, start[listed] + torch.arange(len(listed), device=minor.device) - first


def rasterise_triangles_reference(
    vertices: Float[Tensor, "vertex 3"], faces: Int64[Tensor, "face 3"], camera: Camera, near: float = NEAR
) -> tuple[Int64[Tensor, "height width"], Float[Tensor, "height width 3"], Float[Tensor, "height width"]]:
    """Twin of `triangles.rasterise_triangles`: every pixel's ray meets every face (Moeller and Trumbore 1997).

    Returns:
        Face, barycentric coordinates and depth of every pixel, as in `triangles.TriangleBuffer`.
    """
    height, width = camera.height, camera.width
    rays = camera.rays(camera.pixel_centres().view(-1, 2))
    forward = rays @ camera.rotation[2]
    nearest = torch.full((height * width,), torch.inf, dtype=vertices.dtype, device=vertices.device)
    face = torch.full((height * width,), -1, dtype=torch.int64, device=vertices.device)
    barycentric = vertices.new_zeros(height * width, 3)
    for first in range(0, len(faces), FACES_AT_ONCE):
        a, b, c = vertices[faces[first : first + FACES_AT_ONCE]].unbind(1)
        edge_1, edge_2, offset = b - a, c - a, camera.position - a
        normal = torch.linalg.cross(rays[:, None], edge_2.expand(len(rays), -1, -1), dim=-1)
        determinant = (normal * edge_1).sum(-1)
        v = (normal * offset).sum(-1) / determinant
        other = torch.linalg.cross(offset, edge_1, dim=-1)
        w = rays @ other.T / determinant
        depth = (other * edge_2).sum(-1) / determinant * forward[:, None]
        hit = (v >= 0) & (w >= 0) & (v + w <= 1) & (depth > near)
        depth, which = torch.where(hit, depth, torch.inf).min(dim=1)
        closer = torch.nonzero(depth < nearest).squeeze(1)
        which = which[closer]
        nearest[closer], face[closer] = depth[closer], which + first
        v, w = v[closer, which], w[closer, which]
        barycentric[closer] = torch.stack([1 - v - w, v, w], dim=-1)
    size = (height, width)
    return face.view(size), barycentric.view(*size, 3).float(), nearest.view(size).float()
