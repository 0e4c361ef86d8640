"""Draws wide strands on the CPU, leaving out segments that hair in front of them hides.

Dense hair covers each pixel dozens of times, but only the nearest strand counts. A share of the strands is drawn first;
what it covers hides most segments of the others, which are then not drawn. The keys are exactly those of drawing
everything.
"""

from collections.abc import Sequence
from typing import Any

import torch

from neural_strands.foundation import kernels
from neural_strands.raster.kernels import occlusion as occlusion_kernels

BLOCK = 8
"""Pixels a side of the smallest blocks (`occlusion_kernels.BLOCK`)."""
LEVELS = 3
"""Sizes of blocks; each is twice as large as the one before."""
ROUNDS = 4
"""Rounds in which strands are drawn, every fourth in each."""
VEILED_BEFORE = (0, 1)
"""Rounds before which it is determined what is hidden: by the head at first, then by a quarter of the strands. More
often hides more, but takes longer for sparse hair."""
KERNELS = (
    occlusion_kernels.veil_blocks,
    occlusion_kernels.spread_veils,
    occlusion_kernels.list_unhidden,
    occlusion_kernels.draw_listed,
)
"""Kernels to load before several threads draw."""


def draw_unhidden(
    first: int, count: int, strands: Sequence[Any], taper: Sequence[Any], size: Sequence[int], keys: Any
) -> None:
    """Draw consecutive strands, on the calling thread.

    Args:
        first: index of the first of these strands.
        count: number of strands.
        strands: points of all strands, projection, depth of the near plane, and number of points per strand.
        taper: width of strands, greater than 0, the share of the tip, and parameters of the points.
        size: width and height of the image.
        keys: of all pixels; hold the occluder's depth at the start.
    """
    points, projection, near, per_strand = strands
    cpu = torch.device("cpu")
    across, down = (-(-side // BLOCK) for side in size)
    # (width, height) of each level in blocks, and where each begins.
    shapes = [(-(-across // 2**level), -(-down // 2**level)) for level in range(LEVELS)]
    starts = [sum(wide * high for wide, high in shapes[:level]) for level in range(LEVELS + 1)]
    veil, levels = (kernels.array(kernels.zeros((n,), torch.float32, cpu)) for n in (across * down, starts[-1]))
    most = -(-count // ROUNDS)
    listed, counts = (kernels.array(kernels.zeros((n,), torch.int32, cpu)) for n in (most * (per_strand - 1), most))
    for start in range(ROUNDS):
        if start in VEILED_BEFORE:
            kernels.launch(occlusion_kernels.veil_blocks, across * down, [keys, *size, across, veil], cpu)
            for level, (wide, high) in enumerate(shapes):
                inputs = [veil, across, down, level, starts[level], levels]
                kernels.launch(occlusion_kernels.spread_veils, wide * high, inputs, cpu)
        items = len(range(start, count, ROUNDS))
        shared = [first + start, ROUNDS, points, projection, near]
        inputs = [*shared, taper[0], per_strand, *size, across, down, levels, listed, counts]
        kernels.launch(occlusion_kernels.list_unhidden, items, inputs, cpu)
        inputs = [*shared, *taper, per_strand, *size, listed, counts, keys]
        kernels.launch(occlusion_kernels.draw_listed, items, inputs, cpu)
