"""Warp kernels of the nodes between which visible points are blended (see `raster.nodes`).

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.func
@no_type_check
def is_bent(points: wp.array[wp.vec3], first: int, last: int, straight: float) -> bool:
    """Whether the first and the last segment between two points of a strand differ in direction."""
    begin = points[first + 1] - points[first]
    end = points[last] - points[last - 1]
    return wp.dot(begin, end) < straight * wp.length(begin) * wp.length(end)


@wp.func
@no_type_check
def nodes_of(points: wp.array[wp.vec3], segment: int, per_strand: int, stride: int, straight: float) -> wp.vec2i:
    """The nodes before and after a segment, as indices of points."""
    strand = segment // (per_strand - 1)
    vertex = segment - strand * (per_strand - 1)
    root = strand * per_strand
    first = root + vertex // stride * stride
    last = wp.min(first + stride, root + per_strand - 1)
    if is_bent(points, first, last, straight):
        first = root + vertex
        last = first + 1
    return wp.vec2i(first, last)


@wp.kernel(enable_backward=False)
@no_type_check
def mark_seen(
    start: int,
    segments: wp.array[wp.int64],
    positions: wp.array[float],
    points: wp.array[wp.vec3],
    per_strand: int,
    stride: int,
    straight: float,
    marks: wp.array[int],
) -> None:
    """Mark the nodes around what a line pixel sees, before it is known how many visible points there are.

    The mean of line pixels that see one segment may be rounded to the beginning of the next.
    """
    item = start + wp.tid()
    segment = int(segments[item])
    if segment < 0:
        return
    ends = nodes_of(points, segment, per_strand, stride, straight)
    marks[ends[0]] = 1
    marks[ends[1]] = 1
    if positions[item] > 0.99 and (segment + 1) % (per_strand - 1) != 0:
        ends = nodes_of(points, segment + 1, per_strand, stride, straight)
        marks[ends[0]] = 1
        marks[ends[1]] = 1


@wp.kernel(enable_backward=False)
@no_type_check
def mark_nodes(
    start: int,
    segments: wp.array[wp.int64],
    positions: wp.array[float],
    points: wp.array[wp.vec3],
    per_strand: int,
    stride: int,
    straight: float,
    before: wp.array[wp.int64],
    along: wp.array[float],
    marks: wp.array[int],
) -> None:
    """Find the nodes before and after a visible point, and its position between them; mark them, unless that is done.

    Several items may mark the same point, all with the same value.
    """
    item = start + wp.tid()
    segment = int(segments[item])
    ends = nodes_of(points, segment, per_strand, stride, straight)
    first = ends[0]
    last = ends[1]
    # A point's index exceeds that of its segment by the number of strands before it.
    here = segment + segment // (per_strand - 1)
    before[item] = wp.int64(first)
    along[item] = (float(here - first) + positions[item]) / float(last - first)
    if marks.shape[0] > 0:
        marks[first] = 1
        marks[last] = 1


@wp.kernel(enable_backward=False)
@no_type_check
def blend_nodes(
    start: int,
    values: wp.array2d[wp.vec4],
    before: wp.array[wp.int64],
    along: wp.array[float],
    blended: wp.array2d[wp.vec4],
) -> None:
    """Blend the values of a visible point's two nodes."""
    item = start + wp.tid()
    node = int(before[item])
    share = along[item]
    for quad in range(values.shape[1]):
        here = values[node, quad]
        blended[item, quad] = here + share * (values[node + 1, quad] - here)


@wp.kernel(enable_backward=False)
@no_type_check
def scatter_to_nodes(
    gradients: wp.array2d[wp.vec4],
    before: wp.array[wp.int64],
    along: wp.array[float],
    grad_values: wp.array2d[wp.vec4],
) -> None:
    """Add the gradient of a visible point to its two nodes."""
    item = wp.tid()
    node = int(before[item])
    share = along[item]
    for quad in range(gradients.shape[1]):
        gradient = gradients[item, quad]
        wp.atomic_add(grad_values, node, quad, (1.0 - share) * gradient)
        wp.atomic_add(grad_values, node + 1, quad, share * gradient)
