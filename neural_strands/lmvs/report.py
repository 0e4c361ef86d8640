"""Pictures of a reconstruction, for a few views."""

from pathlib import Path

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import Views
from neural_strands.lmvs.orientation import OrientationConfig
from neural_strands.lmvs.view_cache import ViewCache
from neural_strands.pictures.encoding import write_png
from neural_strands.pictures.fields import depth_picture, orientation_picture
from neural_strands.pictures.lines import segments_over_photograph

SHOWN = 4
"""Number of views shown."""


def write_pictures(views: Views, head: Mesh | None, segments: LineSegments, out: Path) -> None:
    """Write pictures to `out / "report"`: orientation, depth, and segments over the photograph.

    Args:
        views: the views that were reconstructed.
        head: the head, if known; it hides segments behind it.
        segments: the result.
        out: folder of the reconstruction; the lines of the views are read from its `work`.
    """
    cache = ViewCache(out / "work", views, OrientationConfig())
    solved = [i for i in range(len(views)) if cache.has_lines(i)]
    for i in solved[:: max(1, len(solved) // SHOWN)][:SHOWN]:
        camera, lines = views.cameras[i], cache.lines(i)
        pictures = {
            "orientation": orientation_picture(cache.features(i).texture),
            "depth": depth_picture(lines.pixel, lines.depth, (camera.height, camera.width)),
            "segments": segments_over_photograph(views.image(i), segments, camera, head),
        }
        for name, picture in pictures.items():
            write_png(out / "report" / f"{name}_{i:04d}.png", picture)
