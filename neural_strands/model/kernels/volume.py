"""Warp kernel that samples a grid of several channels at points (see `hair_volume.HairVolume.at`).

Warp reads the source of these functions itself: its array types are no Python types, so they are left unchecked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def sample_cells(
    start: int,
    values: wp.array2d[float],
    shape: wp.vec3i,
    low: wp.vec3,
    cell: float,
    world: wp.array[wp.vec3],
    sampled: wp.array2d[float],
) -> None:
    """Trilinear blend of the eight cells whose middles surround a point; beyond the border, that of the border."""
    item = start + wp.tid()
    place = (world[item] - low) / cell
    x = wp.clamp(place[0] - 0.5, 0.0, float(shape[0] - 1))
    y = wp.clamp(place[1] - 0.5, 0.0, float(shape[1] - 1))
    z = wp.clamp(place[2] - 0.5, 0.0, float(shape[2] - 1))
    column = wp.min(int(x), shape[0] - 2)
    row = wp.min(int(y), shape[1] - 2)
    layer = wp.min(int(z), shape[2] - 2)
    ahead = wp.vec3(x - float(column), y - float(row), z - float(layer))
    for corner in range(8):
        i = corner // 4
        j = (corner // 2) % 2
        k = corner % 2
        weight = wp.where(i == 1, ahead[0], 1.0 - ahead[0])
        weight *= wp.where(j == 1, ahead[1], 1.0 - ahead[1])
        weight *= wp.where(k == 1, ahead[2], 1.0 - ahead[2])
        index = ((column + i) * shape[1] + row + j) * shape[2] + layer + k
        for channel in range(values.shape[1]):
            sampled[item, channel] += weight * values[index, channel]
