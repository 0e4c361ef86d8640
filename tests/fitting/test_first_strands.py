"""First strands of a ball that is seen from the front alone, against the true hair behind it."""

import math

import pytest
import torch
from counted_loops import CountedLoops
from parted_hair import parted_strands, patches
from tiny_capture import RADIUS, cameras, combed_strands, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.evaluation.geometry_metrics import Threshold, matched_shares
from neural_strands.evaluation.oriented_points import OrientedPoints, sample_strands
from neural_strands.fitting.first_strands import hair_roots, trace_first_strands
from neural_strands.flow.conservation import ConservationConfig
from neural_strands.flow.curls import CurlConfig
from neural_strands.flow.field import FlowConfig
from neural_strands.flow.hair_flow import InitialConfig, hair_flow, hair_room
from neural_strands.flow.hull import HullConfig
from neural_strands.flow.tracing import TracedStrands, trace_hair
from neural_strands.foundation.progress import Feedback
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import lengths
from neural_strands.geometry.views import Views
from neural_strands.lmvs.growth import GrowthConfig, flip_segments, orient_segments
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import sample_roots

FRONT, BEHIND = math.radians(61), math.radians(115)
"""Largest azimuth of the views kept, and the azimuth beyond which at most one of them sees the hair."""
MATCH = [Threshold(0.005, math.radians(40))]

LOWEST_ROOT = 1.0
"""Polar angle of the lowest true root."""


@pytest.fixture(scope="module")
def head(tmp_path_factory) -> Head:
    folder = tmp_path_factory.mktemp("capture") / "ball"
    write_capture(folder)
    return find_head(Capture.load(folder), None)


def hair_views(strands: torch.Tensor, head: Head) -> Views:
    """Views from all around, with masks of dense hair."""
    seen = [camera.resized(256, 256) for camera in cameras(16)]
    masks = []
    for camera in seen:
        body = rasterise_triangles(head.mesh.vertices, head.mesh.faces, camera)
        masks.append((rasterise_lines(strands, camera, body.depth).segment >= 0).float())
    return Views(tuple(seen), (True,) * len(seen), lambda index, part: masks[index] if part == "hair_mask" else None)


def some(views: Views, keep: list[int]) -> Views:
    kept = tuple(views.cameras[index] for index in keep)
    return Views(kept, (True,) * len(kept), lambda index, part: views.read(keep[index], part))


def first_strands(views: Views, segments: LineSegments, head: Head) -> TracedStrands:
    config = InitialConfig(flow=FlowConfig(spacing=0.003))
    roots = sample_roots(head, 1500, torch.Generator().manual_seed(0))
    roots = roots.select(roots.position[:, 1] > math.cos(LOWEST_ROOT) * RADIUS)
    room = hair_room(segments, views, head.mesh, roots.position, config)
    flow = hair_flow(room, segments, roots.position, roots.normal, config)
    return trace_hair(flow, roots.position, roots.normal, config.trace)


def azimuth(points: torch.Tensor) -> torch.Tensor:
    """Angle about the vertical from the front, without a sign."""
    return torch.atan2(points[..., 0], points[..., 2]).abs()


def behind(points: OrientedPoints) -> OrientedPoints:
    keep = azimuth(points.points) > BEHIND
    return OrientedPoints(points.points[keep], points.directions[keep], points.curve[keep], points.step_index[keep])


def test_hair_that_no_view_sees_continues_what_is_seen(head):
    strands = combed_strands(6000)
    views = hair_views(strands, head)
    front = some(views, [index for index, camera in enumerate(views.cameras) if azimuth(camera.position) < FRONT])
    assert len(front) == 5
    segments = true_segments(strands)
    seen = azimuth(segments.points) < BEHIND
    found = first_strands(front, LineSegments(*(values[seen] for values in vars(segments).values())), head)
    ours, truth = sample_strands(found.points), sample_strands(strands)
    (precision,), _ = matched_shares(behind(ours), truth, MATCH)
    (recall,), _ = matched_shares(behind(truth), ours, MATCH)
    assert 2 * precision * recall / (precision + recall) > 80
    guessed = found.unseen > 0.5
    assert 0.1 < guessed.float().mean() < 0.6
    assert (found.points[guessed].mean(dim=1)[:, 2] < 0.01).all()
    assert guessed[azimuth(found.points.mean(dim=1)) > BEHIND + 0.3].float().mean() > 0.95
    longest, thickest = lengths(found.points[~guessed]).max(), found.points[~guessed].norm(dim=-1).max()
    assert (lengths(found.points) < 1.3 * longest).all()
    assert (found.points.norm(dim=-1) < thickest + 0.005).all()
    assert thickest < RADIUS + 0.03


def test_where_views_see_everything_nothing_is_guessed(head):
    strands = combed_strands(6000)
    found = first_strands(hair_views(strands, head), true_segments(strands), head)
    assert (found.unseen == 0).all()


def test_a_fringe_of_which_little_is_found_lies_on_the_forehead(head: Head, generator: torch.Generator):
    strands = parted_strands(6000)
    found = patches(strands, apart=0.02, radius=0.005)
    mixed = flip_segments(found, torch.rand(found.segment_count, generator=generator) < 0.5)
    segments = orient_segments(mixed, head.mesh, head.scalp_faces, [], GrowthConfig())
    traced = first_strands(hair_views(strands, head), segments, head).points
    # Those that the chart grows beyond the true roots do not count.
    rooted = torch.cdist(traced[:, 0], strands[:, 0]).amin(dim=1) < 0.004
    x, _, z = traced[:, 0].unbind(dim=-1)
    fringe = traced[rooted & (z > 0.03) & (x.abs() < 0.025)]
    assert len(fringe) > 50
    # It crosses the forehead to its end beside it, instead of standing up and leaving the hair.
    assert lengths(fringe).median() > 0.7 * lengths(strands).median()
    tip = fringe[:, -1].median(dim=0).values
    assert tip[0] < -0.6 * RADIUS
    assert tip[1] < 0.4 * RADIUS
    assert fringe[:, -1].norm(dim=-1).median() < RADIUS + 0.01
    _, (signed,) = matched_shares(sample_strands(fringe), sample_strands(strands), MATCH)
    assert signed > 85


def test_roots_keep_off_what_a_view_shows_bare(head):
    # Hair on the right half alone; the chart covers both.
    strands = combed_strands(6000)
    views = hair_views(strands[strands[:, 0, 0] > 0], head)
    config, draw = HullConfig(mask_margin=0.004), torch.Generator
    all_over = sample_roots(head, 400, draw().manual_seed(0)).position
    roots = hair_roots(head, 400, views, config, draw().manual_seed(0))
    assert len(roots) == 400
    assert (all_over[:, 0] < -0.02).float().mean() > 0.2
    assert not (roots.position[:, 0] < -0.02).any()
    places = (all_over[:, 0] > 0.02) & (all_over[:, 1] > 0.3 * RADIUS)
    # None is lost where hair is: each place has a root as near as one of so many can be.
    gap = torch.cdist(all_over[places], roots.position).amin(dim=1)
    assert gap.max() < 0.02
    again = hair_roots(head, 400, views, config, draw().manual_seed(0))
    assert torch.equal(again.position, roots.position)


def test_masks_that_leave_no_scalp_do_not_move_roots(head):
    empty = hair_views(combed_strands(10), head)
    every = sample_roots(head, 100, torch.Generator().manual_seed(0))
    kept = hair_roots(head, 100, empty, HullConfig(mask_margin=0.0), torch.Generator().manual_seed(0))
    assert torch.equal(kept.position, every.position)


def test_every_stage_of_tracing_reports_its_progress_to_the_end(head: Head):
    strands = combed_strands(2000)
    config = InitialConfig(
        flow=FlowConfig(spacing=0.006, iterations=7),
        conservation=ConservationConfig(rounds=3),
        curls=CurlConfig(find=False),
    )
    roots = sample_roots(head, 200, torch.Generator().manual_seed(0))
    counted = CountedLoops()
    distance = SignedDistanceGrid.build(head.mesh, 0.005, 0.05)
    views, feedback = hair_views(strands, head), Feedback(track=counted.track)
    random = torch.Generator().manual_seed(0)
    trace_first_strands(head, true_segments(strands), views, roots, config, distance, random, feedback)
    # 16 masks, 7 sweeps, 3 rounds.
    assert [loop.total for loop in counted.loops] == [16, 7, 3]
    assert all(loop.complete for loop in counted.loops)


def test_a_share_of_the_strands_starts_where_hair_begins_that_views_show(head: Head):
    strands = combed_strands(6000)
    # Views show one lock only, low on one side; it begins higher up.
    near_lock = (strands[:, -1] - strands[0, -1]).norm(dim=-1) < 0.02
    lock = true_segments(strands[near_lock][:, 8:])
    config = InitialConfig(flow=FlowConfig(spacing=0.003), curls=CurlConfig(find=False), seen_share=0.3)
    roots = sample_roots(head, 400, torch.Generator().manual_seed(0))
    distance = SignedDistanceGrid.build(head.mesh, 0.005, 0.05)
    random = torch.Generator().manual_seed(0)
    found = trace_first_strands(head, lock, hair_views(strands, head), roots, config, distance, random)
    from_before = torch.cdist(found.roots.position, roots.position).amin(dim=1) < 1e-4
    moved = ~from_before
    assert 20 < int(moved.sum()) <= 120
    assert len(found.roots) == len(found.strands.points) == 400
    assert (found.roots.distance < 0.002).all()
    near = torch.cdist(found.strands.points.reshape(-1, 3), lock.points).amin(dim=1).reshape(400, -1).amin(dim=1)
    assert (near[moved] < 0.004).float().mean() > 0.9
    assert (near[from_before] < 0.004).float().mean() < 0.4
