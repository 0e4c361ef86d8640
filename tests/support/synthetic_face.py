"""A face of random points before cameras on an arc: landmarks whose place is known exactly."""

import numpy as np
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.face.topology import LANDMARKS, NAMED

SIZE = (640, 480)


def face_points(seed=0) -> np.ndarray:
    """Points on the front of an ellipsoid, metres; the named ones where they belong."""
    random = np.random.default_rng(seed)
    angle = random.uniform(-0.9, 0.9, (LANDMARKS, 2))
    points = np.stack(
        [0.07 * np.sin(angle[:, 0]), 0.10 * np.sin(angle[:, 1]), 0.09 * np.cos(angle[:, 0]) * np.cos(angle[:, 1])],
        axis=1,
    )
    places = {
        "right_eye_outer": (-0.0447, 0.03, 0.06),
        "left_eye_outer": (0.0447, 0.03, 0.06),
        "right_eye_inner": (-0.0162, 0.03, 0.07),
        "left_eye_inner": (0.0162, 0.03, 0.07),
        "right_iris": (-0.0315, 0.03, 0.07),
        "left_iris": (0.0315, 0.03, 0.07),
        "right_cheek": (-0.0685, 0.0, 0.0),
        "left_cheek": (0.0685, 0.0, 0.0),
        "mouth_right": (-0.0262, -0.04, 0.07),
        "mouth_left": (0.0262, -0.04, 0.07),
        "nose_bridge": (0.0, 0.03, 0.085),
        "chin": (0.0, -0.0875, 0.085),
        "right_brow_inner": (-0.02, 0.045, 0.08),
        "left_brow_inner": (0.02, 0.045, 0.08),
    }
    for name, place in places.items():
        points[NAMED[name]] = place
    return points


def arc(count=9, distance=0.8) -> list[Camera]:
    """Cameras from one side of the face to the other."""
    found = []
    for k, turn in enumerate(np.linspace(-0.7, 0.7, count)):
        eye = torch.tensor([distance * np.sin(turn), 0.1 * np.cos(3 * turn), distance * np.cos(turn)]).float()
        found.append(Camera.look_at(eye, torch.zeros(3), 900.0, SIZE, f"{k:03d}.png"))
    return found


def images_of(points: np.ndarray, cameras, noise=0.0, seed=1) -> list[list[np.ndarray]]:
    """One face a view."""
    random = np.random.default_rng(seed)
    images = []
    for camera in cameras:
        pixels, _ = camera.project(torch.from_numpy(points).float())
        images.append([pixels.double().numpy() + noise * random.standard_normal((len(points), 2))])
    return images
