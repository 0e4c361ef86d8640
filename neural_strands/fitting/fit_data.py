"""Inputs of a fit: the training views, loaded one at a time, the line segments and the head."""

import itertools
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.capture.check_views import doubled_poses
from neural_strands.capture.hold_out import FEWEST_VIEWS, training_views
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.losses import OrientedTargets
from neural_strands.fitting.photographs.regions import MarkedPixels, random_square
from neural_strands.fitting.photographs.streak_loss import Streaks, find_streaks
from neural_strands.fitting.photographs.trimap import Trimap, TrimapConfig, reference_alpha, trimap_of_part
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.views import View, Views
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.head import Head

FEWEST_SEGMENT_POINTS = 500
FARTHEST_FROM_HEAD = 0.25
"""Median distance in metres from segments to scalp beyond which they cannot be this head's hair."""
EXACT_WITHIN = 0.01
"""Distance from the head's surface, metres, within which the values at the grid's nodes are exact."""


@dataclass(frozen=True)
class FitData:
    """The inputs of a fit, on its device; images stay on disk until a step needs them.

    Attributes:
        views: only the training views.
        head: mesh and scalp chart.
        segments: oriented line segments.
        targets: points on the segments, indexed for the geometric loss.
        distance: signed distance to the head, on a grid around the hair.
        streaks: streaks of the training views; empty if the fit does not use them.
        marked: the pixels that show hair, of the views that have been used so far.
    """

    views: Views
    head: Head
    segments: LineSegments
    targets: OrientedTargets
    distance: SignedDistanceGrid
    streaks: tuple[Streaks, ...] = ()
    marked: dict[int, MarkedPixels] = field(default_factory=dict, repr=False, compare=False)

    def hair_pixels(self, target: View) -> Bool[Tensor, "height width"]:
        """Pixels of a view that show hair: its mask or, without one, the rasterised segments."""
        if target.hair_mask is not None:
            return target.hair_mask > 0.5
        return rasterise_lines(self.segments.lines(), target.camera).segment >= 0


def head_distance_grid(head: Mesh) -> SignedDistanceGrid:
    """Sample the signed distance to the head on a grid, as accurately as a fit needs it."""
    return SignedDistanceGrid.build(head, exact_within=EXACT_WITHIN)


def gather_fit_data(
    capture: Capture,
    head: Head,
    segments: LineSegments,
    config: FitConfig,
    device: torch.device,
    distance: SignedDistanceGrid | None = None,
    streak_views: int | None = None,
) -> FitData:
    """Gather and check the inputs of a fit.

    Args:
        capture: all views; held-out views are removed here.
        head: mesh and scalp chart.
        segments: line segments of the training views, signed from root to tip.
        config: which views are held out, radii.
        device: device of the tensors.
        distance: signed distance to the head, if the caller has it already; sampling it takes seconds.
        streak_views: number of training views whose streaks are found, which takes seconds for many; None for all.

    Raises:
        InputError: too few views or segments, or a head far from the hair.
    """
    seen = capture.subset(training_views(len(capture), config.hold_out_every))
    check_inputs(seen, segments, head)
    segments, head = segments.to(device), head.to(device)
    radius = config.chamfer.surface_radius
    # Most points of strands are beside the segments, and fewer rows of cells tell that sooner: on two captures searches
    # took a third to an eighth of the time that they took with cells of half the radius.
    grid = PointGrid.build(segments.points, radius, cell=2 * radius)
    data = FitData(
        views=seen.views_on(device),
        head=head,
        segments=segments,
        targets=OrientedTargets(segments.points, segments.directions, grid),
        distance=head_distance_grid(head.mesh) if distance is None else distance,
    )
    if config.weights.streaks == 0:
        return data
    return replace(data, streaks=_streaks(data, config.streaks.longest_side, streak_views))


def _streaks(data: FitData, longest_side: int, most: int | None) -> tuple[Streaks, ...]:
    views = data.views.reduced(longest_side)
    count = len(views) if most is None else min(most, len(views))
    some = itertools.islice(views, count)
    head = data.head.mesh

    def depth(camera: Camera) -> Float[Tensor, "height width"]:
        return rasterise_triangles(camera.posed(head.vertices), head.faces, camera).depth

    return tuple(
        find_streaks(view, data.hair_pixels(view), depth(view.camera))
        for view in track(some, "streaks of the photographs", count)
    )


def random_region(
    data: FitData, view: int, side: int, stride: int, trimap: TrimapConfig, random: torch.Generator
) -> tuple[View, Trimap]:
    """Crop a random square around hair from a training view, with its reference alpha."""
    whole = data.views[view]
    if view not in data.marked:
        data.marked[view] = MarkedPixels.of(data.hair_pixels(whole))
    place = random_square(data.marked[view], (whole.camera.height, whole.camera.width), side, stride, random)
    part = whole.cropped(place)
    if whole.hair_mask is not None:
        return part, reference_alpha(whole.hair_mask, place, trimap)
    return part, trimap_of_part(data.hair_pixels(whole), place, trimap)


def check_views(capture: Capture) -> None:
    """Reject training views that no fit is possible from.

    Raises:
        InputError: there are fewer than three, or all have the same pose.
    """
    if len(capture) < FEWEST_VIEWS:
        raise InputError(
            f"{capture.folder}: expected at least {FEWEST_VIEWS} training views, found {len(capture)}; "
            "take more photographs around the head."
        )
    if sum(doubled_poses(capture.cameras)) == len(capture) - 1:
        raise InputError(
            f"{capture.folder}: expected views from several sides, found {len(capture)} of the same pose; "
            "calibrate the photographs again, or export the cameras again."
        )


def check_inputs(capture: Capture, segments: LineSegments, head: Head) -> None:
    """Reject inputs from which no fit is possible.

    Raises:
        InputError: too few views or segments, or segments that are not this head's hair.
    """
    check_views(capture)
    if len(segments) < FEWEST_SEGMENT_POINTS:
        raise InputError(
            f"{capture.folder}: expected {FEWEST_SEGMENT_POINTS} segment points or more, found {len(segments)}; "
            "check focus, masks and cameras with `neural-strands check`."
        )
    scalp = head.mesh.vertices[head.mesh.faces[head.scalp_faces]].mean(dim=1)
    sample = segments.points[:: max(1, len(segments) // 2000)]
    distance = float(torch.cdist(sample, scalp).amin(dim=1).median())
    if not distance < FARTHEST_FROM_HEAD:
        raise InputError(
            f"{capture.folder}: expected hair within {FARTHEST_FROM_HEAD:g} m of the scalp, found a median of "
            f"{distance:.2f} m; the head is not in the frame of these cameras: align or scale it."
        )
