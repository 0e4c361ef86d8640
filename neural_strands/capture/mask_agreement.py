"""How well the hair masks of a capture agree, and how many views therefore have to show that a place is empty.

Where the mask of one view misses hair, a hull that every view carves loses hair that all others show. The masks tell if
that happens: exact ones leave room for hair along the ray of every pixel of hair. If too many rays have no room, two
views have to show that a place is empty. Otherwise one is enough, because exact masks then carve a better hull.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from neural_strands.capture.capture import Capture
from neural_strands.capture.mask_border import with_corrected_masks
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.views import Views
from neural_strands.geometry.visual_hull import HeadView, Silhouette, points_before_head, possible_points
from neural_strands.raster.dilation import widen

LONGEST_SIDE = 512
"""Longer side of views as compared, pixels."""
MOST_VIEWS = 16
"""Largest number of views whose pixels are examined; the masks of all of them carve."""
PIXELS = 300
"""Number of pixels of hair that are examined in each of these views."""
STEP, REACH = 0.003, 0.4
"""Distance between the points of a ray, and from the middle of the head to the farthest of them, metres. Hair hardly
hangs farther, and outside the pictures, where no mask carves, there is always room."""
SOME, MOST = 0.2, 0.5
"""Coverage up to which a pixel is empty, and above which it certainly shows hair."""
DOUBTFUL = 0.01
"""Share of hair without room above which masks count as contradictory: exact ones have none, those
that `prepare` computes 0.02 to 0.12."""


def with_judged_masks(
    capture: Capture, judged: Sequence[int], head: Mesh | None, say: Callable[[str], None]
) -> Capture:
    """Correct where a capture's hair masks end, then require two views to carve if they contradict each other.

    Args:
        capture: all views.
        judged: indices of the views that may be used to judge the masks.
        head: the head in the cameras' frame; without one, nothing is known about contradictions.
        say: called with a message for each fault.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    capture = with_corrected_masks(capture, capture.subset(judged), say)
    share = 0.0 if head is None else share_without_room(capture.subset(judged).views_on(), head)
    if share <= DOUBTFUL:
        return capture
    part = f"{100 * share:.1f} % of the hair"
    say(f"hair masks contradict each other ({part}); a place now counts as empty only if two views show it")
    return replace(capture, witnesses=2)


def share_without_room(views: Views, head: Mesh) -> float:
    """Share of the pixels of hair along whose rays the masks of all views leave no room for hair.

    Args:
        views: with hair masks; no photograph is read.
        head: stops the rays, and hides what is behind it.
    """
    index, middle = MeshIndex(head), head.vertices.mean(dim=0)
    masks = list(views.reduced(LONGEST_SIDE).hair_masks())
    # Widened by a pixel, because cameras, too, are a little off.
    silhouettes = [Silhouette(HeadView.of(camera, index), widen(mask, 1) >= SOME) for camera, mask in masks]
    missed = examined = 0
    for camera, mask in masks[:: max(1, -(-len(masks) // MOST_VIEWS))]:
        hair = (mask > MOST).nonzero().flip(1)
        rays = camera.rays(hair[:: max(1, len(hair) // PIXELS)].float() + 0.5)
        points, counts = points_before_head(camera, rays, middle, index, STEP, REACH)
        room = possible_points(points.reshape(-1, 3), silhouettes).reshape(counts.shape) & counts
        judged = counts.any(dim=1)
        examined += int(judged.sum())
        missed += int((judged & ~room.any(dim=1)).sum())
    return missed / max(examined, 1)
