"""Warp kernels that ask a mesh's bounding volume hierarchy for closest points and signs.

A query's u and v are the weights of the first and the second corner of its face.
"""

# Warp's kernel language is not Python's type system: these rules do not hold inside it.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

FARTHEST = wp.constant(1.0e6)
"""Metres beyond which a query gives up; larger than any scene."""

ACCURACY = wp.constant(2.0)
"""Distance over size from which a cluster of faces counts as one dipole in the winding number (Barill et al. 2018)."""

INSIDE = 0.5
"""Winding number above which a point is inside."""

_INSIDE = wp.constant(INSIDE)


@wp.kernel(enable_backward=False)
@no_type_check
def closest_kernel(
    start: int,
    mesh: wp.uint64,
    points: wp.array[wp.vec3],
    face: wp.array[wp.int32],
    weights: wp.array[wp.vec3],
) -> None:
    """Closest face of each point and the barycentric weights of its closest point."""
    i = start + wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], FARTHEST)
    face[i] = query.face
    weights[i] = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)


@wp.kernel(enable_backward=False)
@no_type_check
def signed_kernel(
    start: int,
    mesh: wp.uint64,
    lower: wp.vec3,
    upper: wp.vec3,
    points: wp.array[wp.vec3],
    face: wp.array[wp.int32],
    weights: wp.array[wp.vec3],
    sign: wp.array[wp.float32],
) -> None:
    """The same with the sign of the winding number; nothing outside the mesh's box (`lower` to `upper`) is inside."""
    i = start + wp.tid()
    p = points[i]
    beyond = wp.max(wp.max(lower - p, p - upper))
    if beyond > 0.0:
        outer = wp.mesh_query_point_no_sign(mesh, p, FARTHEST)
        face[i] = outer.face
        weights[i] = wp.vec3(outer.u, outer.v, 1.0 - outer.u - outer.v)
        sign[i] = 1.0
    else:
        inner = wp.mesh_query_point_sign_winding_number(mesh, p, FARTHEST, ACCURACY, _INSIDE)
        face[i] = inner.face
        weights[i] = wp.vec3(inner.u, inner.v, 1.0 - inner.u - inner.v)
        sign[i] = inner.sign


@wp.kernel(enable_backward=False)
@no_type_check
def trilinear_kernel(
    start: int,
    values: wp.array3d[wp.float32],
    lower: wp.vec3,
    spacing: float,
    points: wp.array[wp.vec3],
    value: wp.array[wp.float32],
    gradient: wp.array[wp.vec3],
) -> None:
    """Trilinear value and gradient of a grid (z, y, x) at each point; clamped to the border, where slopes vanish."""
    i = start + wp.tid()
    last = wp.vec3(float(values.shape[2] - 1), float(values.shape[1] - 1), float(values.shape[0] - 1))
    raw = (points[i] - lower) / spacing
    cell = wp.min(wp.max(raw, wp.vec3(0.0)), last)
    x = wp.min(int(cell[0]), values.shape[2] - 2)
    y = wp.min(int(cell[1]), values.shape[1] - 2)
    z = wp.min(int(cell[2]), values.shape[0] - 2)
    u = cell[0] - float(x)
    v = cell[1] - float(y)
    w = cell[2] - float(z)
    # Along x on the four edges, then along y on the two faces, then along z.
    a00 = wp.lerp(values[z, y, x], values[z, y, x + 1], u)
    a10 = wp.lerp(values[z, y + 1, x], values[z, y + 1, x + 1], u)
    a01 = wp.lerp(values[z + 1, y, x], values[z + 1, y, x + 1], u)
    a11 = wp.lerp(values[z + 1, y + 1, x], values[z + 1, y + 1, x + 1], u)
    d00 = values[z, y, x + 1] - values[z, y, x]
    d10 = values[z, y + 1, x + 1] - values[z, y + 1, x]
    d01 = values[z + 1, y, x + 1] - values[z + 1, y, x]
    d11 = values[z + 1, y + 1, x + 1] - values[z + 1, y + 1, x]
    b0 = wp.lerp(a00, a10, v)
    b1 = wp.lerp(a01, a11, v)
    slope = wp.vec3(wp.lerp(wp.lerp(d00, d10, v), wp.lerp(d01, d11, v), w), wp.lerp(a10 - a00, a11 - a01, w), b1 - b0)
    for k in range(3):
        if raw[k] != cell[k]:
            slope[k] = 0.0
    value[i] = wp.lerp(b0, b1, w)
    gradient[i] = slope / spacing
