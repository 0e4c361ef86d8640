"""Checks of the cameras: do they see the head, from all sides, at a plausible scale?"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.findings import Finding
from neural_strands.capture.hold_out import FEWEST_VIEWS, HOLD_OUT_EVERY, training_views
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.rays import nearest_to_rays, spread_directions
from neural_strands.scalp.hairline import measure_head
from neural_strands.scalp.head_file import HEAD_WIDTH, is_head_width

LIKELY_WIDTH = (0.1, 0.25)
"""Likely width of a head, from a child's to one with thick ears, metres."""
FRAME_WIDTH = (0.15, 3.0)
"""Plausible width of an image at the distance of the head, metres."""
SEEN_SHARE = 0.3
"""A camera sees the head if at least this share of the head's vertices falls into its image."""
REACH = 45.0
"""Angle around a viewing direction within which hair counts as covered by it, degrees."""
COVERED_SHARE = 0.5
"""Smallest share of all directions around the head that should be covered."""
FEW_VIEWS = 12
"""Fewer views than this give a warning: the geometry would be poor."""
SAME_POSE = 1e-6
"""Poses whose 4 x 4 matrices differ by less are the same."""
DIRECTIONS = 1000
"""Number of directions around the head in which coverage is tested."""


def subject_centre(cameras: Sequence[Camera], head: Mesh | None) -> Float[Tensor, "3"]:
    """The middle of the head or, without one, the point nearest to all optical axes."""
    if head is not None:
        return 0.5 * (head.vertices.amin(dim=0) + head.vertices.amax(dim=0))
    positions, axes = [camera.position for camera in cameras], [camera.rotation[2] for camera in cameras]
    return nearest_to_rays(torch.stack(positions), torch.stack(axes))


def check_scale(cameras: Sequence[Camera], head: Mesh | None) -> Finding:
    """Check that the unit of the calibration is plausibly the metre."""
    if head is not None:
        width = measure_head(head.vertices).width
        if LIKELY_WIDTH[0] <= width <= LIKELY_WIDTH[1]:
            return Finding("scale", "good", f"the head is {width:.2f} m wide")
        # A fit refuses heads outside the range that `is_head_width` allows.
        level = "warning" if is_head_width(width) else "error"
        text = f"the head is {width:.3g} m wide, expected {LIKELY_WIDTH[0]} to {LIKELY_WIDTH[1]}"
        action = f"multiply the cameras' translations and the head by about {HEAD_WIDTH / max(width, 1e-9):.2g}"
        return Finding("scale", level, text, action)
    centre = subject_centre(cameras, None)
    distances = torch.stack([(camera.position - centre).norm() for camera in cameras])
    focal = torch.tensor([float(camera.intrinsics[0, 0]) / camera.width for camera in cameras])
    width = float((distances / focal).median())
    if FRAME_WIDTH[0] <= width <= FRAME_WIDTH[1]:
        return Finding("scale", "good", f"an image spans {width:.2f} m at the subject (no head to measure by)")
    return Finding(
        "scale",
        "warning",
        f"an image spans {width:.3g} m at the subject, expected {FRAME_WIDTH[0]} to {FRAME_WIDTH[1]}: the scale of the "
        "calibration is arbitrary",
        "scale the cameras' translations to metres, or give a head in the same scale (head.obj)",
    )


def check_aim(cameras: Sequence[Camera], head: Mesh | None) -> Finding:
    """Check that each camera has the head (or the point that all look at) in its image."""
    points = subject_centre(cameras, None)[None] if head is None else head.vertices
    blind = tuple(camera.name for camera in cameras if _seen_share(camera, points) < SEEN_SHARE)
    subject = "head" if head is not None else "point that the others look at"
    if not blind:
        return Finding("aim", "good", f"every camera sees the {subject}")
    return Finding(
        "aim",
        "error" if len(blind) == len(cameras) else "warning",
        f"{len(blind)} of {len(cameras)} cameras do not see the {subject}",
        "remove these views, or check that head and cameras are in the same frame (y up, metres, OpenGL poses)",
        blind,
    )


def check_viewpoints(cameras: Sequence[Camera], head: Mesh | None) -> Finding:
    """Check that there are enough views, all around the head."""
    centre = subject_centre(cameras, head)
    toward = torch.nn.functional.normalize(torch.stack([camera.position for camera in cameras]) - centre, dim=-1)
    nearest = (spread_directions(DIRECTIONS) @ toward.T).amax(dim=1)
    covered = float((nearest >= torch.cos(torch.deg2rad(torch.tensor(REACH)))).float().mean())
    spread = float(torch.rad2deg(torch.acos((toward @ toward.T).min().clamp(-1, 1))))
    facts = f"{len(cameras)} views, {spread:.0f}° apart at most, cover {100 * covered:.0f} % of all directions"
    action = f"take at least {FEW_VIEWS}, better 24, from all around and above"
    if len(training_views(len(cameras), HOLD_OUT_EVERY)) < FEWEST_VIEWS:
        return Finding("viewpoints", "error", f"a fit needs {FEWEST_VIEWS} views or more: {facts}", action)
    if len(cameras) < FEW_VIEWS:
        return Finding("viewpoints", "warning", f"few views: {facts}", action)
    if covered < COVERED_SHARE:
        action = "take views all around and above: hair that no view sees has to be invented"
        return Finding("viewpoints", "warning", f"a narrow range: {facts}", action)
    return Finding("viewpoints", "good", facts)


def check_doubles(cameras: Sequence[Camera]) -> Finding | None:
    """Report views with the same pose, a sign of a broken export."""
    same = doubled_poses(cameras)
    if not any(same):
        return None
    if sum(same) == len(cameras) - 1:
        text = "all views have the same pose, so that no depth can be determined"
        return Finding("poses", "error", text, "calibrate the photographs again, or export the cameras again")
    names = tuple(camera.name for camera, doubled in zip(cameras, same, strict=True) if doubled)
    return Finding("poses", "warning", "some views have the same pose as another", "export the cameras again", names)


def doubled_poses(cameras: Sequence[Camera]) -> list[bool]:
    """Whether an earlier camera has the same pose, for each camera."""
    poses = torch.stack([camera.world_to_camera for camera in cameras]).reshape(len(cameras), -1)
    # The matrix product that cdist uses for many rows would separate equal poses by rounding.
    apart = torch.cdist(poses, poses, compute_mode="donot_use_mm_for_euclid_dist")
    return (apart < SAME_POSE).triu(diagonal=1).any(dim=0).tolist()


def _seen_share(camera: Camera, points: Float[Tensor, "point 3"]) -> float:
    pixels, depth = camera.project(points)
    size = pixels.new_tensor([camera.width, camera.height])
    return float(((pixels >= 0) & (pixels <= size)).all(dim=-1).logical_and(depth > 0).float().mean())
