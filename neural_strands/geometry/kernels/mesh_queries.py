"""Warp kernels that query a mesh's bounding volume hierarchy for closest points, signs and ray hits.

A query's u and v are the weights of the first and the second corner of its face.
"""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

FARTHEST = wp.constant(1.0e6)
"""Largest distance of a query, metres; larger than any scene."""

ACCURACY = wp.constant(2.0)
"""Ratio of distance to size above which a cluster of faces is treated as one dipole in the winding number (Barill et
al. 2018)."""

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
    """Like `closest_kernel`, with the sign of the winding number; points beyond `lower` or `upper` are outside."""
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
def ray_kernel(start: int, mesh: wp.uint64, origin: wp.vec3, ray: wp.array[wp.vec3], distance: wp.array[float]) -> None:
    """Distance along each unit ray to the first face; unchanged if there is none."""
    i = start + wp.tid()
    hit = wp.mesh_query_ray(mesh, origin, ray[i], FARTHEST)
    if hit.result:
        distance[i] = hit.t
