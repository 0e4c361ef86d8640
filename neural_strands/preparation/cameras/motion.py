"""How a part of the body moved between photographs.

Cameras are found from everything that photographs show, mostly from the room, but people sway. This is a bundle
adjustment (Triggs et al., Bundle Adjustment - A Modern Synthesis, 1999) of points on a head or a torso, which may turn
and shift a little in each photograph. Such points alone hold cameras weakly: without an expectation of small motion,
their arrangement would bend.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float64, Int64
from scipy import sparse
from scipy.spatial.transform import Rotation
from torch import Tensor

from neural_strands.geometry.cameras import Camera

NOISE = 1.0
"""Scale of the Cauchy weights of reprojection errors, pixels."""
ROUNDS, ENOUGH = 30, 1e-5
"""Largest number of steps, and relative gain below which they end."""
LEAST_DAMPING, MOST_DAMPING = 1e-7, 1e6
"""Bounds of the Levenberg-Marquardt damping."""


@dataclass(frozen=True)
class Expected:
    """Standard deviations of a motion.

    Attributes:
        turn: about the middle, radians.
        shift: in the cameras' unit.
    """

    turn: float
    shift: float


@dataclass(frozen=True)
class Tracks:
    """Points, and where photographs show them.

    Attributes:
        position: in the cameras' frame; each point is shown by at least two photographs.
        camera: number of the camera of each sighting.
        point: number of the point that it shows.
        pixel: where it shows it.
    """

    position: Float64[np.ndarray, "point 3"]
    camera: Int64[np.ndarray, " sighting"]
    point: Int64[np.ndarray, " sighting"]
    pixel: Float64[np.ndarray, "sighting 2"]


@dataclass(frozen=True)
class Motion:
    """Where a head or a torso was in each photograph.

    Attributes:
        turn: rotation vector about the middle, radians.
        shift: in the cameras' unit.
        position: the points where they are if it has not moved.
        middle: of the head or the torso.
    """

    turn: Float64[np.ndarray, "camera 3"]
    shift: Float64[np.ndarray, "camera 3"]
    position: Float64[np.ndarray, "point 3"]
    middle: Float64[np.ndarray, "3"]

    def transforms(self) -> Float64[Tensor, "camera 4 4"]:
        """The motion as rigid transforms."""
        turned = Rotation.from_rotvec(self.turn).as_matrix()
        moved = np.tile(np.eye(4), (len(turned), 1, 1))
        moved[:, :3, :3], moved[:, :3, 3] = turned, self.middle + self.shift - turned @ self.middle
        return torch.from_numpy(moved)

    def followed(self, cameras: Sequence[Camera]) -> tuple[Camera, ...]:
        """The cameras relative to a head that moved, which is the world."""
        moved = []
        for camera, motion in zip(cameras, self.transforms(), strict=True):
            pose, room = camera.world_to_camera.double() @ motion, motion.to(camera.world_to_camera)
            moved.append(replace(camera, world_to_camera=pose.to(room), world_to_room=room))
        return tuple(moved)

    def size(self) -> tuple[float, float]:
        """Root mean square of the turn, degrees, and of the shift, in the cameras' unit."""
        turn, shift = (float(np.sqrt((each**2).sum(axis=1).mean())) for each in (self.turn, self.shift))
        return float(np.degrees(turn)), shift


@dataclass(frozen=True)
class _Lenses:
    """Cameras as arrays: rotation, translation, focal lengths and principal point."""

    rotation: Float64[np.ndarray, "camera 3 3"]
    translation: Float64[np.ndarray, "camera 3"]
    focal: Float64[np.ndarray, "camera 2"]
    centre: Float64[np.ndarray, "camera 2"]

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> "_Lenses":
        pose = np.stack([camera.world_to_camera.double().numpy() for camera in cameras])
        matrix = np.stack([camera.intrinsics.double().numpy() for camera in cameras])
        return cls(pose[:, :3, :3], pose[:, :3, 3], matrix[:, [0, 1], [0, 1]], matrix[:, :2, 2])


def find_motion(
    cameras: Sequence[Camera], tracks: Tracks, middle: Float64[np.ndarray, "3"], expected: Expected
) -> Motion:
    """Find the most likely motion of a head or a torso, by Levenberg and Marquardt's method.

    Args:
        cameras: in any frame and unit, placed by something else.
        tracks: points on the head or the torso.
        middle: of it.
        expected: how far it may have moved.
    """
    lenses, still = _Lenses.of(cameras), np.zeros((len(cameras), 3))
    motion = Motion(still, still, tracks.position, middle)
    deviation = np.array([expected.turn] * 3 + [expected.shift] * 3)
    cost, damping = _cost(lenses, tracks, motion, deviation), 1e-4
    for _ in range(ROUNDS):
        system, before = _normal_equations(lenses, tracks, motion, deviation), cost
        while damping < MOST_DAMPING:
            trial = _stepped(motion, system, damping)
            cost = _cost(lenses, tracks, trial, deviation)
            if cost <= before:
                motion = trial
                break
            damping *= 10
        if cost > (1 - ENOUGH) * before:
            break
        damping = max(damping / 10, LEAST_DAMPING)
    return motion


@dataclass(frozen=True)
class _System:
    """Normal equations: blocks of cameras and of points, what couples them, and the right-hand sides."""

    cameras: Float64[np.ndarray, "camera 6 6"]
    points: Float64[np.ndarray, "point 3 3"]
    coupling: sparse.csr_matrix
    camera_side: Float64[np.ndarray, "camera 6"]
    point_side: Float64[np.ndarray, "point 3"]


def _errors(
    lenses: _Lenses, tracks: Tracks, motion: Motion
) -> tuple[Float64[np.ndarray, "sighting 2"], Float64[np.ndarray, "sighting 3"], Float64[np.ndarray, "sighting 3"]]:
    """Reprojection errors, the turned points relative to the middle, and the points in the cameras' frames."""
    turn = Rotation.from_rotvec(motion.turn).as_matrix()[tracks.camera]
    arm = np.einsum("nij,nj->ni", turn, motion.position[tracks.point] - motion.middle)
    moved = arm + motion.middle + motion.shift[tracks.camera]
    place = np.einsum("nij,nj->ni", lenses.rotation[tracks.camera], moved) + lenses.translation[tracks.camera]
    seen = lenses.focal[tracks.camera] * place[:, :2] / place[:, 2:] + lenses.centre[tracks.camera]
    return seen - tracks.pixel, arm, place


def _cost(lenses: _Lenses, tracks: Tracks, motion: Motion, deviation: Float64[np.ndarray, "6"]) -> float:
    error, _, _ = _errors(lenses, tracks, motion)
    robust = NOISE**2 * np.log1p((error**2).sum(axis=1) / NOISE**2).sum()
    return float(robust + ((np.hstack([motion.turn, motion.shift]) / deviation) ** 2).sum())


def _normal_equations(lenses: _Lenses, tracks: Tracks, motion: Motion, deviation: Float64[np.ndarray, "6"]) -> _System:
    error, arm, place = _errors(lenses, tracks, motion)
    weight = 1.0 / (1.0 + (error**2).sum(axis=1) / NOISE**2)
    near, focal, count = 1.0 / place[:, 2], lenses.focal[tracks.camera], len(error)
    slope = np.zeros((count, 2, 3))
    slope[:, [0, 1], [0, 1]] = focal * near[:, None]
    slope[:, :, 2] = -focal * place[:, :2] * near[:, None] ** 2
    shifted = slope @ lenses.rotation[tracks.camera]
    # A turn by w moves the end of an arm a by the vector product of w and a.
    cross = np.zeros((count, 3, 3))
    cross[:, [0, 1, 2], [1, 2, 0]], cross[:, [1, 2, 0], [0, 1, 2]] = arm[:, [2, 0, 1]], -arm[:, [2, 0, 1]]
    by_camera = np.concatenate([shifted @ cross, shifted], axis=2)
    by_point = shifted @ Rotation.from_rotvec(motion.turn).as_matrix()[tracks.camera]
    weighted = weight[:, None, None] * by_camera
    cameras, points = np.zeros((len(motion.turn), 6, 6)), np.zeros((len(motion.position), 3, 3))
    camera_side, point_side = np.zeros((len(cameras), 6)), np.zeros((len(points), 3))
    np.add.at(cameras, tracks.camera, weighted.transpose(0, 2, 1) @ by_camera)
    np.add.at(points, tracks.point, weight[:, None, None] * by_point.transpose(0, 2, 1) @ by_point)
    np.add.at(camera_side, tracks.camera, -np.einsum("nki,nk->ni", weighted, error))
    np.add.at(point_side, tracks.point, -weight[:, None] * np.einsum("nki,nk->ni", by_point, error))
    cameras[:, range(6), range(6)] += deviation**-2
    camera_side -= np.hstack([motion.turn, motion.shift]) / deviation**2
    row = 6 * tracks.camera[:, None, None] + np.arange(6)[:, None]
    column = 3 * tracks.point[:, None, None] + np.arange(3)
    blocks = weighted.transpose(0, 2, 1) @ by_point
    entries = (each.ravel() for each in np.broadcast_arrays(row, column))
    coupling = sparse.csr_matrix((blocks.ravel(), tuple(entries)), (camera_side.size, point_side.size))
    return _System(cameras, points, coupling, camera_side, point_side)


def _stepped(motion: Motion, system: _System, damping: float) -> Motion:
    """Solve the damped equations; points are eliminated, so that a small dense system is left."""
    cameras, points = system.cameras.copy(), system.points.copy()
    cameras[:, range(6), range(6)] *= 1 + damping
    points[:, range(3), range(3)] *= 1 + damping
    inverse = np.linalg.inv(points)
    count = len(inverse)
    solved = system.coupling @ sparse.bsr_matrix((inverse, np.arange(count), np.arange(count + 1)))
    left = sparse.block_diag(list(cameras)).toarray() - (solved @ system.coupling.T).toarray()
    step = np.linalg.solve(left, system.camera_side.ravel() - solved @ system.point_side.ravel())
    moved = system.point_side - (system.coupling.T @ step).reshape(-1, 3)
    turn, shift = step.reshape(-1, 6)[:, :3], step.reshape(-1, 6)[:, 3:]
    return replace(
        motion,
        turn=(Rotation.from_rotvec(turn) * Rotation.from_rotvec(motion.turn)).as_rotvec(),
        shift=motion.shift + shift,
        position=motion.position + np.einsum("nij,nj->ni", inverse, moved),
    )
