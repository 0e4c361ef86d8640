"""Pinhole cameras: OpenCV axes (x right, y down, z forward), intrinsics in pixels, pixel centres at +0.5."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.devices.transfers import sent
from neural_strands.foundation.smoothstep import smoothstep

OPENGL_TO_OPENCV = (1.0, -1.0, -1.0, 1.0)
"""Diagonal that converts OpenGL camera axes (y up, z backward) to OpenCV's and back."""


@dataclass(frozen=True)
class TorsoMotion:
    """How a person's torso had moved, relative to the head, when a photograph was taken.

    Attributes:
        motion: rigid transform from where the torso lies in the world to where it was.
        neck: upper and lower end of the neck's axis; what lies above the one stays with the head, and what lies below
            the other moves with the torso.
    """

    motion: Float[Tensor, "4 4"]
    neck: Float[Tensor, "2 3"]

    def moved(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Points of the body where they were; linear blend skinning along the neck."""
        axis = self.neck[1] - self.neck[0]
        share = smoothstep((points - self.neck[0]) @ axis / (axis @ axis))[..., None]
        carried = points @ self.motion[:3, :3].T + self.motion[:3, 3]
        return torch.lerp(points, carried, share)

    def to(self, device: torch.device | str) -> "TorsoMotion":
        """Move both to `device`."""
        return TorsoMotion(sent(self.motion, device), sent(self.neck, device))


@dataclass(frozen=True)
class Camera:
    """One calibrated view.

    Attributes:
        intrinsics: fx, fy, cx, cy and skew in pixels; the centre of the top-left pixel is (0.5, 0.5).
        world_to_camera: rigid transform from world metres to camera metres.
        width: image width in pixels.
        height: image height in pixels.
        name: name of the view, in messages and files.
        world_to_room: rigid transform from world metres to those of the room, if the person, who carries the world
            along, had moved when this photograph was taken; None if both are the same.
        torso: how the person's torso had moved relative to the head, which carries the world along; None if it had not.

    Examples:
        >>> import torch
        >>> import neural_strands as ns
        >>> eye, target = torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3)
        >>> camera = ns.Camera.look_at(eye, target, focal=600.0, size=(512, 256), name="front")
        >>> camera.position, camera.resized(256, 128).intrinsics[0, 0]
        (tensor([0., 0., 1.]), tensor(300.))
    """

    intrinsics: Float[Tensor, "3 3"]
    world_to_camera: Float[Tensor, "4 4"]
    width: int
    height: int
    name: str = ""
    world_to_room: Float[Tensor, "4 4"] | None = None
    torso: TorsoMotion | None = None

    @classmethod
    def from_opengl(
        cls,
        camera_to_world: Float[Tensor, "4 4"],
        intrinsics: Float[Tensor, "3 3"],
        size: tuple[int, int],
        name: str = "",
    ) -> "Camera":
        """Build from a nerfstudio/Blender camera-to-world matrix (y up, z backward); `size` is width, height."""
        flip = torch.diag(camera_to_world.new_tensor(OPENGL_TO_OPENCV))
        return cls(intrinsics, rigid_inverse(camera_to_world @ flip), size[0], size[1], name)

    @classmethod
    def from_colmap(
        cls,
        quaternion: Float[Tensor, "4"],
        translation: Float[Tensor, "3"],
        intrinsics: Float[Tensor, "3 3"],
        size: tuple[int, int],
        name: str = "",
    ) -> "Camera":
        """Build from COLMAP's world-to-camera quaternion (w, x, y, z) and translation; `size` is width, height."""
        transform = torch.eye(4, dtype=quaternion.dtype, device=quaternion.device)
        transform[:3, :3] = quaternion_to_matrix(quaternion)
        transform[:3, 3] = translation
        return cls(intrinsics, transform, size[0], size[1], name)

    @classmethod
    def look_at(
        cls,
        eye: Float[Tensor, "3"],
        target: Float[Tensor, "3"],
        focal: float,
        size: tuple[int, int],
        name: str = "",
    ) -> "Camera":
        """Place a camera at `eye` facing `target`, world y up; `focal` in pixels, `size` is width, height."""
        forward = torch.nn.functional.normalize(target - eye, dim=0)
        up = eye.new_tensor([0.0, 1.0, 0.0])
        if forward[1].abs() > 0.999:
            up = eye.new_tensor([0.0, 0.0, -1.0])
        right = torch.nn.functional.normalize(torch.linalg.cross(forward, up), dim=0)
        down = torch.linalg.cross(forward, right)
        rotation = torch.stack([right, down, forward])
        transform = torch.eye(4, dtype=eye.dtype, device=eye.device)
        transform[:3, :3] = rotation
        transform[:3, 3] = -rotation @ eye
        return cls(pinhole(focal, size).to(eye), transform, size[0], size[1], name)

    @property
    def rotation(self) -> Float[Tensor, "3 3"]:
        """World to camera rotation."""
        return self.world_to_camera[:3, :3]

    @property
    def position(self) -> Float[Tensor, "3"]:
        """Optical centre in world metres."""
        return -self.rotation.T @ self.world_to_camera[:3, 3]

    @property
    def camera_to_world(self) -> Float[Tensor, "4 4"]:
        """The inverse rigid transform, OpenCV axes."""
        return rigid_inverse(self.world_to_camera)

    @property
    def opengl_camera_to_world(self) -> Float[Tensor, "4 4"]:
        """The camera-to-world matrix that nerfstudio and Blender write (y up, z backward)."""
        return self.camera_to_world @ torch.diag(self.world_to_camera.new_tensor(OPENGL_TO_OPENCV))

    def to(self, device: torch.device | str) -> "Camera":
        """Move all matrices to `device`."""
        room = None if self.world_to_room is None else sent(self.world_to_room, device)
        return replace(
            self,
            intrinsics=sent(self.intrinsics, device),
            world_to_camera=sent(self.world_to_camera, device),
            world_to_room=room,
            torso=None if self.torso is None else self.torso.to(device),
        )

    def in_room(self) -> "Camera":
        """The camera relative to the room, for what does not move with the person."""
        if self.world_to_room is None:
            return self
        pose = self.world_to_camera @ rigid_inverse(self.world_to_room)
        return replace(self, world_to_camera=pose, world_to_room=None, torso=None)

    def posed(self, body: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Points of the body where they were when the photograph was taken."""
        return body if self.torso is None else self.torso.moved(body)

    def on_torso(self) -> "Camera":
        """The camera relative to the torso, for what moves with it below the neck."""
        if self.torso is None:
            return self
        return replace(self, world_to_camera=self.world_to_camera @ self.torso.motion, world_to_room=None, torso=None)

    def transform(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """World metres to camera metres."""
        return points @ self.rotation.T + self.world_to_camera[:3, 3]

    def project(self, points: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch 2"], Float[Tensor, "*batch"]]:
        """Project world points to pixels and depth along the optical axis (metres; not positive behind the camera).

        A point in the plane of the camera has no image: its pixel is infinite or NaN, and its depth is 0.
        """
        in_camera = self.transform(points)
        homogeneous = in_camera @ self.intrinsics.T
        return homogeneous[..., :2] / homogeneous[..., 2:], in_camera[..., 2]

    def unproject(self, pixels: Float[Tensor, "*batch 2"], depth: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Lift pixels at a depth along the optical axis (metres) to world points."""
        homogeneous = torch.cat([pixels, torch.ones_like(pixels[..., :1])], dim=-1)
        in_camera = (homogeneous @ self._inverse_intrinsics().T) * depth[..., None]
        return (in_camera - self.world_to_camera[:3, 3]) @ self.rotation

    def rays(self, pixels: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 3"]:
        """Unit world directions from the optical centre through `pixels`."""
        homogeneous = torch.cat([pixels, torch.ones_like(pixels[..., :1])], dim=-1)
        directions = homogeneous @ (self._inverse_intrinsics().T @ self.rotation)
        return torch.nn.functional.normalize(directions, dim=-1)

    def ray_planes(self, step: int = 1) -> Float[Tensor, "3 height width"]:
        """`rays` through all pixel centres, with the axes first: several times as fast on the CPU.

        Args:
            step: side of a pixel; the last ones may reach beyond the picture.
        """
        at = {"dtype": self.intrinsics.dtype, "device": self.intrinsics.device}
        x, y = (step * (torch.arange(-(-side // step), **at) + 0.5) for side in (self.width, self.height))
        columns, rows, ahead = self._inverse_intrinsics().T @ self.rotation
        planes = columns[:, None, None] * x + rows[:, None, None] * y[:, None] + ahead[:, None, None]
        return planes / planes.square().sum(dim=0).sqrt()

    def pixel_centres(self) -> Float[Tensor, "height width 2"]:
        """The coordinates of every pixel's centre."""
        x = torch.arange(self.width, device=self.intrinsics.device, dtype=self.intrinsics.dtype) + 0.5
        y = torch.arange(self.height, device=self.intrinsics.device, dtype=self.intrinsics.dtype) + 0.5
        return torch.stack(torch.meshgrid(x, y, indexing="xy"), dim=-1)

    def _inverse_intrinsics(self) -> Float[Tensor, "3 3"]:
        """Inverse of the intrinsics. Unlike `inv`, `inv_ex` does not synchronise with CUDA to check invertibility."""
        return torch.linalg.inv_ex(self.intrinsics).inverse

    def footprint(self, depth: float) -> float:
        """Width in metres that one pixel covers at `depth` metres."""
        focal = 0.5 * (self.intrinsics[0, 0] + self.intrinsics[1, 1])
        return depth / float(focal)

    def resized(self, width: int, height: int) -> "Camera":
        """The same view with another number of pixels."""
        x, y, ahead = self.intrinsics
        scaled = torch.stack([x * (width / self.width), y * (height / self.height), ahead])
        return replace(self, intrinsics=scaled, width=width, height=height)

    def reduced(self, longest_side: int) -> "Camera":
        """The same view with at most `longest_side` pixels along the longer side, in proportion."""
        scale = longest_side / max(self.width, self.height)
        if scale >= 1.0:
            return self
        return self.resized(max(1, round(self.width * scale)), max(1, round(self.height * scale)))

    def cropped(self, left: int, top: int, width: int, height: int) -> "Camera":
        """The part of the view that starts `left` and `top` pixels in, with the same rays through the same pixels."""
        shift = torch.zeros_like(self.intrinsics)
        shift[0, 2], shift[1, 2] = left, top
        return replace(self, intrinsics=self.intrinsics - shift, width=width, height=height)


def pinhole(focal: float, size: tuple[int, int]) -> Float[Tensor, "3 3"]:
    """Intrinsics with square pixels and the principal point in the middle; `focal` in pixels."""
    width, height = size
    return torch.tensor([[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]])


def rigid_inverse(transform: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    """Invert a rotation and translation without a general solve."""
    inverse = torch.eye(4, dtype=transform.dtype, device=transform.device)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse


def quaternion_to_matrix(quaternion: Float[Tensor, "4"]) -> Float[Tensor, "3 3"]:
    """Rotation matrix of a quaternion (w, x, y, z), normalised first."""
    w, x, y, z = torch.nn.functional.normalize(quaternion, dim=0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row) for row in rows])
