"""The pictures of a reconstruction, for a few views, in one folder."""

from collections.abc import Sequence
from pathlib import Path

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.lmvs.orientation import OrientationConfig
from neural_strands.lmvs.pictures import depth_picture, orientation_picture, save_picture, segments_picture
from neural_strands.lmvs.search_range import warp_mesh
from neural_strands.lmvs.view_cache import ViewCache
from neural_strands.lmvs.views import View

SHOWN = 4
"""Views that are shown."""


def write_report(views: Sequence[View], head: Mesh | None, segments: LineSegments, out: Path) -> None:
    """Write OUT/report from what OUT/work holds: orientation, depth, and segments over the photograph."""
    work = ViewCache(out / "work", views, OrientationConfig())
    solved = [i for i in range(len(views)) if work.has_lines(i)]
    mesh = None if head is None else warp_mesh(head)
    for i in solved[:: max(1, len(solved) // SHOWN)][:SHOWN]:
        name = f"{i:04d}.png"
        camera = views[i].camera
        save_picture(out / "report" / f"orientation_{name}", orientation_picture(work.features(i)))
        save_picture(out / "report" / f"depth_{name}", depth_picture(camera, work.lines(i)))
        picture = segments_picture(camera, views[i].load_image(), segments, mesh)
        save_picture(out / "report" / f"segments_{name}", picture)
