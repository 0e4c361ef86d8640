"""Converts between a browser's camera and ours, and chooses the view that a page starts with."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera, pinhole, quaternion_to_matrix, rigid_inverse
from neural_strands.geometry.turntable import turntable_cameras

FIELD_OF_VIEW = math.radians(25.0)
"""Vertical field of view of the page's first view, radians."""
RAISED = 0.4
"""Height of the hair above the middle of a narrow window, whose lower half the panel covers; 0.5 is the border."""
NEAREST = 0.1
"""Least distance of the point that the camera orbits, metres."""
SAME_TURN, SAME_PLACE = math.radians(1.0), 2e-3
"""Tolerances, radians and metres, for cameras to be considered the same: browsers compute in single precision."""


@dataclass(frozen=True)
class PageCamera:
    """A browser's camera: its image fills the canvas, with the optical axis in the middle.

    Attributes:
        wxyz: rotation from camera to world, OpenCV axes, as a quaternion.
        position: optical centre, world metres.
        field_of_view: vertical, radians.
        aspect: width of the canvas over its height.
    """

    wxyz: tuple[float, float, float, float]
    position: tuple[float, float, float]
    field_of_view: float
    aspect: float

    def sized(self, longest: int) -> Camera:
        """The camera with `longest` pixels along the longer side of the canvas."""
        width = longest if self.aspect >= 1 else max(round(longest * self.aspect), 1)
        height = longest if self.aspect < 1 else max(round(longest / self.aspect), 1)
        pose = torch.eye(4)
        pose[:3, :3] = quaternion_to_matrix(torch.tensor(self.wxyz, dtype=torch.float32))
        pose[:3, 3] = torch.tensor(self.position, dtype=torch.float32)
        focal = 0.5 * height / math.tan(0.5 * self.field_of_view)
        return Camera(pinhole(focal, (width, height)), rigid_inverse(pose), width, height)

    def stands_at(self, pose: "Pose") -> bool:
        """Whether this camera has the position and direction of a pose, regardless of its image."""
        aim = torch.tensor(pose.look_at) - torch.tensor(pose.position)
        forward = quaternion_to_matrix(torch.tensor(self.wxyz, dtype=torch.float32))[:, 2]
        turn = float(forward @ torch.nn.functional.normalize(aim, dim=0))
        return turn > math.cos(SAME_TURN) and math.dist(self.position, pose.position) < SAME_PLACE


@dataclass(frozen=True)
class Pose:
    """Position and target of a camera.

    Attributes:
        position: optical centre, world metres.
        look_at: point on the optical axis that the camera orbits, world metres.
        up: direction that is up in the image.
        field_of_view: vertical, radians.
    """

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]
    field_of_view: float


def start_pose(points: Float[Tensor, "point 3"], aspect: float = 1.0) -> Pose:
    """A pose in front of the face (+z) with all points in the image; one metre away if there are none.

    Args:
        points: world metres.
        aspect: width of the canvas over its height; in a narrow window the camera is farther away and lower.
    """
    finite = points[points.isfinite().all(dim=1)]
    if len(finite) == 0:
        return Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), FIELD_OF_VIEW)
    camera = turntable_cameras(finite[None], 1, (512, 512))[0]
    centre, narrow = 0.5 * (finite.amin(dim=0) + finite.amax(dim=0)), min(aspect, 1.0)
    eye = centre + (camera.position - centre) / narrow
    # The points fill at most the share `narrow` of the image's height.
    height = 2 * math.tan(0.5 * FIELD_OF_VIEW) * float((eye - centre).norm())
    drop = centre.new_tensor([0.0, RAISED * (1 - narrow) * height, 0.0])
    eye, centre = eye - drop, centre - drop
    return Pose(_triple(eye), _triple(centre), (0.0, 1.0, 0.0), FIELD_OF_VIEW)


def photograph_pose(camera: Camera, aspect: float, centre: Float[Tensor, "3"]) -> Pose:
    """A pose at which the canvas shows all of a photograph.

    Args:
        camera: camera of the photograph.
        aspect: width of the canvas over its height.
        centre: centre of the hair; the camera orbits the point on the optical axis nearest to it.
    """
    (fx, _, cx), (_, fy, cy) = camera.intrinsics[:2].tolist()
    tall = max(cy, camera.height - cy) / fy
    wide = max(cx, camera.width - cx) / fx
    axis, eye = camera.rotation[2], camera.position
    distance = max(float((centre - eye) @ axis), NEAREST)
    field_of_view = 2 * math.atan(max(tall, wide / aspect))
    return Pose(_triple(eye), _triple(eye + distance * axis), _triple(-camera.rotation[1]), field_of_view)


def _triple(values: Float[Tensor, "3"]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
