"""Warp kernels of simulated rods: one thread moves one rod by one step (see `editing.rods.step`)."""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.editing.kernels.outside import raised
from neural_strands.geometry.kernels.voxel_grid import blend, cell_about, nearest_place, slope


@wp.func
@no_type_check
def turn_between(first: wp.vec3, second: wp.vec3) -> wp.quat:
    """The smallest rotation from one unit vector to another; the identity if they are opposite."""
    axis = wp.cross(first, second)
    real = 1.0 + wp.dot(first, second)
    if real < 1.0e-6:
        return wp.quat(0.0, 0.0, 0.0, 1.0)
    return wp.normalize(wp.quat(axis[0], axis[1], axis[2], real))


@wp.kernel(enable_backward=False)
@no_type_check
def measure_turns(
    start: int,
    rest: wp.array2d[wp.vec3],
    length: wp.array2d[float],
    here: wp.array2d[wp.vec3],
    turns: wp.array2d[wp.quat],
) -> None:
    """Rotation of each segment relative to rest, transported from the root so that the rod does not twist."""
    rod = start + wp.tid()
    turn = wp.quat(0.0, 0.0, 0.0, 1.0)
    for k in range(length.shape[1]):
        direction = (rest[rod, k + 1] - rest[rod, k]) / length[rod, k]
        now = wp.normalize(here[rod, k + 1] - here[rod, k])
        turn = turn_between(wp.quat_rotate(turn, direction), now) * turn
        turns[rod, k] = turn


@wp.func
@no_type_check
def push_out(
    origin: wp.vec3,
    spacing: float,
    values: wp.array3d[float],
    point: wp.vec3,
    clearance: float,
) -> wp.vec3:
    """Displacement that lifts a point to `clearance` above the body; zero if it is already there."""
    shape = wp.vec3i(values.shape[0], values.shape[1], values.shape[2])
    cell = cell_about(nearest_place((point - origin) / spacing, shape), shape)
    missing = clearance - blend(values, cell)
    if missing <= 0.0:
        return wp.vec3(0.0)
    return missing * wp.normalize(slope(values, cell))


@wp.func
@no_type_check
def restore_lengths(
    rod: int,
    length: wp.array2d[float],
    inverse_mass: wp.array2d[float],
    here: wp.array2d[wp.vec3],
    ratio: wp.array2d[float],
    tension: wp.array2d[float],
) -> None:
    """One Newton step on the lengths of all segments together: a tridiagonal system, solved from the root outwards."""
    count = length.shape[1]
    past = wp.vec3(0.0)
    before = wp.float32(0.0)
    for k in range(count):
        step = here[rod, k + 1] - here[rod, k]
        size = wp.length(step)
        along = step / wp.max(size, 1.0e-9)
        off = -inverse_mass[rod, k] * wp.dot(past, along)
        pivot = inverse_mass[rod, k] + inverse_mass[rod, k + 1]
        right = size - length[rod, k]
        if k > 0:
            pivot -= off * ratio[rod, k - 1]
            right -= off * before
        after = here[rod, wp.min(k + 2, count)] - here[rod, k + 1]
        follow = -inverse_mass[rod, k + 1] * wp.dot(along, after / wp.max(wp.length(after), 1.0e-9))
        ratio[rod, k] = follow / pivot
        before = right / pivot
        tension[rod, k] = before
        past = along
    for k in range(count - 1):
        j = count - 2 - k
        tension[rod, j] = tension[rod, j] - ratio[rod, j] * tension[rod, j + 1]
    pull = wp.vec3(0.0)
    first = here[rod, 0]
    for k in range(count):
        second = here[rod, k + 1]
        force = tension[rod, k] * wp.normalize(second - first)
        here[rod, k] = first + inverse_mass[rod, k] * (force - pull)
        pull = force
        first = second
    here[rod, count] = first - inverse_mass[rod, count] * pull


@wp.kernel(enable_backward=False)
@no_type_check
def bend(
    start: int,
    seconds: float,
    drag: float,
    rest: wp.array2d[wp.vec3],
    length: wp.array2d[float],
    mass: wp.array2d[float],
    stiffness: wp.array2d[float],
    diagonal: wp.array2d[wp.float64],
    first_below: wp.array2d[wp.float64],
    second_below: wp.array2d[wp.float64],
    here: wp.array2d[wp.vec3],
    velocity: wp.array2d[wp.vec3],
    push: wp.array2d[wp.vec3],
    turns: wp.array2d[wp.quat],
    moved: wp.array2d[wp.vec3d],
) -> None:
    """Take an implicit step with inertia, drag, wind, weight and bending, without constraints on lengths.

    The matrix is L D L^T with two subdiagonals of L, in double precision, because short hair is stiff; unknowns are
    the displacements from rest of all points but the root.
    """
    rod = start + wp.tid()
    count = length.shape[1]
    rate = 1.0 / seconds
    for k in range(1, count + 1):
        away = here[rod, k] - rest[rod, k]
        force = mass[rod, k] * (rate * (rate + drag) * away + rate * velocity[rod, k] + push[rod, k])
        moved[rod, k] = wp.vec3d(force)
    for k in range(1, count):
        # The groom's bend at point k as transported by the rod, minus the same bend at rest.
        one, two = 1.0 / length[rod, k - 1], 1.0 / length[rod, k]
        groom = two * (rest[rod, k + 1] - rest[rod, k]) - one * (rest[rod, k] - rest[rod, k - 1])
        target = stiffness[rod, k] * (wp.quat_rotate(turns[rod, k - 1], groom) - groom)
        moved[rod, k + 1] += wp.vec3d(two * target)
        moved[rod, k] -= wp.vec3d((one + two) * target)
        if k > 1:
            moved[rod, k - 1] += wp.vec3d(one * target)
    for k in range(2, count + 1):
        moved[rod, k] -= first_below[rod, k] * moved[rod, k - 1]
        if k > 2:
            moved[rod, k] -= second_below[rod, k] * moved[rod, k - 2]
    for i in range(count):
        k = count - i
        value = moved[rod, k] / diagonal[rod, k]
        if k < count:
            value -= first_below[rod, k + 1] * moved[rod, k + 1]
        if k < count - 1:
            value -= second_below[rod, k + 2] * moved[rod, k + 2]
        moved[rod, k] = value


@wp.kernel(enable_backward=False)
@no_type_check
def constrain(
    start: int,
    seconds: float,
    friction: float,
    rounds: int,
    rest: wp.array2d[wp.vec3],
    length: wp.array2d[float],
    inverse_mass: wp.array2d[float],
    clearance: wp.array2d[float],
    origin: wp.vec3,
    spacing: float,
    values: wp.array3d[float],
    collide: int,
    moved: wp.array2d[wp.vec3d],
    ratio: wp.array2d[float],
    tension: wp.array2d[float],
    here: wp.array2d[wp.vec3],
    velocity: wp.array2d[wp.vec3],
) -> None:
    """Enforce lengths and the body on the points from `bend`, then derive velocities from the motion."""
    rod = start + wp.tid()
    count = length.shape[1]
    # The array of velocities stores the previous points until the end.
    for k in range(1, count + 1):
        velocity[rod, k] = here[rod, k]
        here[rod, k] = rest[rod, k] + wp.vec3(moved[rod, k])
    for _ in range(rounds):
        restore_lengths(rod, length, inverse_mass, here, ratio, tension)
        if collide != 0:
            for k in range(1, count + 1):
                point = here[rod, k]
                way = push_out(origin, spacing, values, point, clearance[rod, k])
                if wp.length_sq(way) > 0.0:
                    outward = wp.normalize(way)
                    slid = point - velocity[rod, k]
                    slid = slid - wp.dot(slid, outward) * outward
                    here[rod, k] = point + way - friction * slid
    # Remaining errors are small; this pass removes all stretch and all points inside.
    for k in range(count):
        before = here[rod, k]
        step = length[rod, k] * wp.normalize(here[rod, k + 1] - before)
        if collide != 0:
            for _ in range(rounds):
                way = push_out(origin, spacing, values, before + step, clearance[rod, k + 1])
                missing = wp.length(way)
                if missing == 0.0:
                    break
                step = raised(step, way / missing, missing)
        here[rod, k + 1] = before + step
    for k in range(1, count + 1):
        velocity[rod, k] = (here[rod, k] - velocity[rod, k]) / seconds
