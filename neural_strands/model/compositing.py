"""Hair over what lies behind it (paper, 4.3), and which pixels it can reach. All colours are linear."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.geometry.rectangle import Rectangle
from neural_strands.raster.lines import LineBuffer
from neural_strands.raster.openings import Openings
from neural_strands.raster.splat import MINIMUM_WEIGHT

REACH = 6
"""Distance from the strands, in pixels, up to which the network may add hair."""
DENSEST = 0.995
"""Mean coverage above which `surrounding_odds` grows no more."""
COVERED, BESIDE = 0.001, 0.02
"""Weights in what shows through the hair of a pixel, in which its open line pixels count 1: its covered ones, and the
open ones of the nine pixels around it."""
CONTEXT = 14
"""Pixels beyond the farthest that may show hair which the image generator also sees."""


def surrounding_odds(coverage: Float[Tensor, "height width"]) -> Float[Tensor, "height width"]:
    """Logit of the mean coverage of 5 x 5 pixels where that is above a half, and 0 elsewhere.

    Fewer strands are drawn than grow on a head, so dense hair has small gaps where a photograph has none.
    """
    mean = F.avg_pool2d(coverage[None, None], 5, stride=1, padding=2, count_include_pad=False)[0, 0]
    return torch.logit(mean.clamp(0.5, DENSEST))


def near_hair(coverage: Float[Tensor, "height width"]) -> Float[Tensor, "height width"]:
    """1 within `REACH` pixels of any strand, along rows and columns, and 0 beyond three times that distance.

    Training sees only squares around the hair, so nothing else keeps the network from a faint haze far from it.
    """
    near = (_sum_around((coverage > 0).to(coverage.dtype), 2 * REACH) > 0).to(coverage.dtype)
    down, across = (_places_around(size, near) for size in near.shape)
    return _sum_around(near, REACH) / (down[:, None] * across)


def _sum_around(image: Float[Tensor, "height width"], reach: int) -> Float[Tensor, "height width"]:
    """Sum over the square of pixels up to `reach` away; exact for small whole numbers, and as fast for any `reach`."""
    for axis, pad in ((0, (0, 0, reach + 1, reach)), (1, (reach + 1, reach))):
        size, total = image.shape[axis], F.pad(image, pad).cumsum(axis)
        image = total.narrow(axis, 2 * reach + 1, size) - total.narrow(axis, 0, size)
    return image


def _places_around(size: int, like: Tensor) -> Float[Tensor, " place"]:
    """Number of pixels up to `REACH` away from each of a row of `size` pixels, itself included."""
    place = torch.arange(size, device=like.device)
    return ((place + REACH).clamp(max=size - 1) - (place - REACH).clamp(min=0) + 1).to(like.dtype)


def hair_rectangle(coverage: Float[Tensor, "height width"], stride: int) -> Rectangle:
    """The rectangle that holds all pixels in which `near_hair` allows hair, and `CONTEXT` more on each side.

    Args:
        coverage: of each pixel by strands.
        stride: the corner is a multiple of this many pixels, and so is each side that does not end at the border.
    """
    height, width = coverage.shape
    margin = 3 * REACH + CONTEXT

    def extent(covered: Bool[Tensor, " pixel"], length: int) -> tuple[int, int]:
        place = covered.nonzero()
        if len(place) == 0:
            return 0, min(stride, length)
        begin, end = max(int(place[0]) - margin, 0), min(int(place[-1]) + 1 + margin, length)
        begin = begin // stride * stride
        return begin, min(begin + -(-(end - begin) // stride) * stride, length) - begin

    covered = coverage.detach() > 0
    (left, across), (top, down) = extent(covered.any(dim=0), width), extent(covered.any(dim=1), height)
    return Rectangle(left, top, across, down)


def compose(
    hair: Float[Tensor, "height width 3"],
    alpha: Float[Tensor, "height width"],
    behind: Float[Tensor, "height width 3"],
) -> Float[Tensor, "height width 3"]:
    """Hair over what lies behind it, in linear light: I = a C + (1 - a) B."""
    return torch.lerp(behind, hair, alpha[..., None])


def weighted_gradient(
    image: Float[Tensor, "height width channel"], weight: Float[Tensor, "height width"]
) -> Float[Tensor, "height width channel"]:
    """The unchanged image, with the gradient of each pixel multiplied by its weight."""
    return image.detach() + weight[..., None] * (image - image.detach())


def area_mean(image: Float[Tensor, "fine_height fine_width channel"], factor: int) -> Float[Tensor, "h w channel"]:
    """Mean over squares of `factor` x `factor` pixels, without incomplete squares at the right and at the bottom."""
    if factor == 1:
        return image
    height, width, channels = image.shape[0] // factor, image.shape[1] // factor, image.shape[2]
    whole = image[: height * factor, : width * factor]
    # Sums of whole rows, then of columns: many times as fast on the CPU as pooling a picture of few channels.
    rows = whole.reshape(height, factor, -1).unbind(1)
    columns = sum(rows[1:], rows[0]).view(height, width, factor, channels).unbind(2)
    return sum(columns[1:], columns[0]) / factor**2


def between_lines(
    colour: Float[Tensor, "height width 3"], seen: Openings
) -> tuple[Float[Tensor, "height width 1"], Float[Tensor, "height width 3"]]:
    """Share of each pixel that is body, and the body's colour times that share, in what lines leave open.

    Where the outline of a face crosses a pixel and hair fills the rest of it, only face is seen between the lines.
    Means over the whole pixel would mix in background and draw a rim of it along the face. Beside that outline opacity
    is lower, too, because fewer lines are near; what shows through there is what neighbouring pixels leave open.

    Args:
        colour: of the body, one per pixel; zero where there is none.
        seen: what lines leave open of each pixel, with the body as the surface.
    """
    colour = colour.permute(2, 0, 1).contiguous()
    around = BESIDE * _mean_around(torch.cat([colour * seen.open_surface, seen.open_surface[None], seen.open[None]]))
    weight, own = seen.open + COVERED + around[4], seen.open_surface + COVERED * seen.surface
    return ((own + around[3]) / weight)[..., None], ((colour * own + around[:3]) / weight).permute(1, 2, 0)


def _mean_around(image: Float[Tensor, "channel height width"]) -> Float[Tensor, "channel height width"]:
    """Sum over 3 x 3 pixels, divided by nine; takes a quarter of the time of `avg_pool2d` on the CPU."""
    padded = F.pad(image, (1, 1, 1, 1))
    rows = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    return (rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:]) / 9


def drawn_share(lines: LineBuffer, factor: int) -> Float[Tensor, "height width"]:
    """Share of each pixel covered by lines, which are drawn at `factor` times the image's resolution."""
    return area_mean((lines.segment >= 0)[..., None].float(), factor)[..., 0]


def filled_from_coarser(
    pyramid: list[Float[Tensor, "channel _ _"]], coverages: list[Float[Tensor, "_ _"]]
) -> Float[Tensor, "channel height width"]:
    """The finest of the splatted maps, with gaps filled from the next coarser map, and so on."""
    image = pyramid[-1]
    for features, coverage in zip(reversed(pyramid[:-1]), reversed(coverages[:-1]), strict=True):
        height, width = coverage.shape
        above = F.interpolate(image[None], scale_factor=2.0, mode="bilinear")[0, :, :height, :width]
        image = features + (1 - coverage / MINIMUM_WEIGHT).clamp(min=0.0) * above
    return image
