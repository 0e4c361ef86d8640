"""Between a browser's camera and ours; the view that a page starts with."""

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
"""How far above the middle the hair starts in a narrow window, whose lower half the panel covers; 0.5 is the border."""
NEAREST = 0.1
"""Least distance of the point that the page turns around, metres."""
SAME_TURN, SAME_PLACE = math.radians(1.0), 2e-3
"""How far two cameras may differ and still be the same, radians and metres: browsers compute in single precision."""


@dataclass(frozen=True)
class PageCamera:
    """A camera as a browser describes it: its image fills the canvas, the optical axis in the middle.

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
        """Whether this camera stands at a pose and looks the same way, whatever its image."""
        aim = torch.tensor(pose.look_at) - torch.tensor(pose.position)
        forward = quaternion_to_matrix(torch.tensor(self.wxyz, dtype=torch.float32))[:, 2]
        turn = float(forward @ torch.nn.functional.normalize(aim, dim=0))
        return turn > math.cos(SAME_TURN) and math.dist(self.position, pose.position) < SAME_PLACE


@dataclass(frozen=True)
class Pose:
    """Where a camera stands and what it looks at.

    Attributes:
        position: optical centre, world metres.
        look_at: a point on the optical axis, world metres: the page turns around it.
        up: direction that is up in the image.
        field_of_view: vertical, radians.
    """

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]
    field_of_view: float


def start_pose(points: Float[Tensor, "point 3"], aspect: float = 1.0) -> Pose:
    """The face in front (+z), all of the points in the image; one metre away where there are none.

    Args:
        points: world metres.
        aspect: width of the canvas over its height: in a narrow window the camera stands farther away, and lower.
    """
    finite = points[points.isfinite().all(dim=1)]
    if len(finite) == 0:
        return Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), FIELD_OF_VIEW)
    camera = turntable_cameras(finite[None], 1, (512, 512))[0]
    centre, narrow = 0.5 * (finite.amin(dim=0) + finite.amax(dim=0)), min(aspect, 1.0)
    eye = centre + (camera.position - centre) / narrow
    # The points take at most the share `narrow` of the image's height.
    height = 2 * math.tan(0.5 * FIELD_OF_VIEW) * float((eye - centre).norm())
    drop = centre.new_tensor([0.0, RAISED * (1 - narrow) * height, 0.0])
    eye, centre = eye - drop, centre - drop
    return Pose(_triple(eye), _triple(centre), (0.0, 1.0, 0.0), FIELD_OF_VIEW)


def photograph_pose(camera: Camera, aspect: float, centre: Float[Tensor, "3"]) -> Pose:
    """Where the page's camera has to stand so that a canvas holds all of a photograph.

    Args:
        camera: that took the photograph.
        aspect: width of the canvas over its height.
        centre: of the hair; the point to turn around is the one on the optical axis nearest to it.
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
