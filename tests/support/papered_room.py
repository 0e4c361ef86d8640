"""A room with papered walls, floor and ceiling, as background of photographs whose cameras are to be found."""

import math
from pathlib import Path

import cv2
import numpy as np
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.photographs.folder import Photograph, write_picture

WALL = 1.8
"""Metres from the middle of the room to each wall."""
BLOTS = (8, 24, 72, 200)
"""Numbers of blots across a wall, from the coarsest to the finest."""


def wallpaper(random: np.random.Generator, side: int = 512, blots: tuple[int, ...] = BLOTS) -> np.ndarray:
    """Blots of many sizes from white to blue, sRGB bytes."""
    paper = np.zeros((side, side, 1))
    for cells in blots:
        noise = cv2.resize(random.random((cells, cells)), (side, side), interpolation=cv2.INTER_NEAREST)
        paper += cv2.GaussianBlur(noise, (0, 0), 1.0)[..., None] / len(blots)
    shade = np.clip((paper - 0.5) * 2.5 + 0.5, 0, 1)
    return np.array([90.0, 130.0, 190.0]) * (1 - shade) + np.array([235.0, 238.0, 240.0]) * shade


def room(camera: Camera, papers: list[np.ndarray]) -> np.ndarray:
    """What a camera sees of the room: (height, width, 3), sRGB bytes."""
    eye = camera.position.numpy().astype(np.float64)
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    inverse = np.linalg.inv(camera.intrinsics.numpy().astype(np.float64))
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ inverse.T @ camera.rotation.numpy()
    # Distance to each of the two walls across an axis; the nearest wall ahead is seen.
    reach = (np.where(rays > 0, WALL, -WALL) - eye) / rays
    axis = reach.argmin(axis=-1)
    hit = eye + reach.min(axis=-1)[..., None] * rays
    picture = np.zeros((*axis.shape, 3))
    for wall in range(6):
        here = (axis == wall // 2) & ((np.take_along_axis(rays, axis[..., None], -1)[..., 0] > 0) == (wall % 2 == 1))
        across = np.delete(hit, wall // 2, axis=-1).astype(np.float32)
        place = (across / (2 * WALL) + 0.5) * (len(papers[wall]) - 1)
        picture[here] = cv2.remap(papers[wall], place[..., 0], place[..., 1], cv2.INTER_LINEAR)[here]
    return picture


def photographed_room(folder: Path) -> tuple[Path, list[Photograph]]:
    """Eight photographs of a room with patterned walls, whose names contain spaces."""
    random = np.random.default_rng(0)
    papers = [wallpaper(random) for _ in range(6)]
    images, shots = folder / "photographs", []
    images.mkdir()
    for k in range(8):
        eye = torch.tensor([0.8 * math.sin(0.25 * k), 0.1 * math.sin(k), 0.8 * math.cos(0.25 * k)])
        camera = Camera.look_at(eye, torch.zeros(3), 300.0, (256, 256), f"of a room {k}.png")
        write_picture(images / camera.name, room(camera, papers).round().astype(np.uint8))
        shots.append(Photograph(camera.name, f"of a room {k}.jpg", 256, 256, 300.0))
    return images, shots
