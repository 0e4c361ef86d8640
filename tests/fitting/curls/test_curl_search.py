"""Curls are found in drawn photographs of curly hair, and in those of straight hair none."""

import math
import re
from dataclasses import replace
from typing import NamedTuple

import pytest
import torch
from counted_loops import CountedLoops, Loop
from tiny_capture import RADIUS, ball, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting import first_strands
from neural_strands.fitting.curls.comparison import PITCHES, SLOPES, Comparison, photographs
from neural_strands.fitting.curls.curl_search import OF_NOISE, WAVY, FoundCurls, curl_strands, find_curls
from neural_strands.fitting.curls.helices import lean_off_gravity, leaning_segments
from neural_strands.fitting.curls.streaks import drawn_hair
from neural_strands.flow.curls import Curl, Locks, curled
from neural_strands.flow.field import FlowConfig
from neural_strands.flow.hair_flow import HairRoom, InitialConfig, hair_flow, hair_room
from neural_strands.flow.tracing import trace_hair
from neural_strands.foundation.progress import Feedback
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import directions, lengths, segments
from neural_strands.geometry.views import Views
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.roots import sample_roots

CONFIG = InitialConfig(flow=FlowConfig(spacing=0.006))
TRUE = Curl(0.005, 0.03, -1)
SCALP = torch.from_numpy(ball().triangles_center[:, 1] > 0.02).nonzero()[:, 0]
SIDE, FOCAL, VIEWS, STRANDS = 160, 262.5, 5, 1200


def hanging_axes(count: int, points: int = 120) -> torch.Tensor:
    """Strands from the top of the ball that lie on it down to its equator and hang 12 cm from there."""
    random = torch.Generator().manual_seed(3)
    azimuth = 2 * math.pi * torch.rand(count, 1, generator=random)
    start = 0.15 + 1.0 * torch.rand(count, 1, generator=random)
    layer = RADIUS + 0.003 + 0.012 * torch.rand(count, 1, generator=random)
    arc = (0.5 * math.pi - start) * layer + 0.12
    along = arc * torch.linspace(0, 1, points)
    polar = (start + along / layer).clamp(max=0.5 * math.pi)
    below = (along - (0.5 * math.pi - start) * layer).clamp(min=0)
    rise = (along / 0.03).clamp(max=1)
    radius = RADIUS * (1 - rise) + layer * rise
    around = radius * polar.sin()
    return torch.stack([around * azimuth.sin(), radius * polar.cos() - below, around * azimuth.cos()], dim=-1)


def combed_around(axes: torch.Tensor, twist: float) -> torch.Tensor:
    """Strands combed round the head, by `twist` radians per metre that they fall."""
    angle = twist * (axes[:, :1, 1] - axes[..., 1]).clamp(min=0)
    cosine, sine = angle.cos(), angle.sin()
    x, y, z = axes.unbind(dim=-1)
    return torch.stack([cosine * x + sine * z, y, cosine * z - sine * x], dim=-1)


def head() -> Mesh:
    return Mesh(torch.from_numpy(ball().vertices).float(), torch.from_numpy(ball().faces).long())


class Photographed:
    """Hair on the ball: its photographs, and as segments the points that they show, with tangents of any sign."""

    def __init__(self, strands: torch.Tensor) -> None:
        cameras, images, masks, seen = [], [], [], []
        tangents = directions(strands)
        random = torch.Generator().manual_seed(0)
        for k in range(VIEWS):
            angle = 2 * math.pi * k / VIEWS
            eye = torch.tensor([0.55 * math.sin(angle), 0.05, 0.55 * math.cos(angle)])
            camera = Camera.look_at(eye, torch.tensor([0.0, -0.03, 0.0]), FOCAL, (SIDE, SIDE), f"{k:03d}")
            body = rasterise_triangles(head().vertices, head().faces, camera)
            buffer = rasterise_lines(strands, camera, body.depth)
            hair = buffer.segment >= 0
            bright = torch.where(hair, drawn_hair(strands, camera, random), 0.8)
            cameras.append(camera)
            images.append(bright[..., None].expand(-1, -1, 3))
            masks.append(hair.float())
            owner, place = buffer.segment[hair] // (strands.shape[1] - 1), buffer.segment[hair] % (strands.shape[1] - 1)
            seen.append(torch.cat([strands[owner, place], tangents[owner, place]], dim=1)[::3])
        parts = {"image": images, "hair_mask": masks, "person_mask": [None] * VIEWS}
        self.views = Views(tuple(cameras), (True,) * VIEWS, lambda index, part: parts[part][index])
        points = torch.cat(seen)
        sign = torch.where(torch.rand(len(points), 1, generator=random) < 0.5, -1.0, 1.0)
        count = len(points)
        self.segments = LineSegments(points[:, :3], sign * points[:, 3:], torch.ones(count), torch.arange(count))
        self.roots = strands[:, 0]
        self.normals = torch.nn.functional.normalize(self.roots, dim=-1)

    def room(self) -> HairRoom:
        return hair_room(self.segments, self.views, head(), self.roots, CONFIG)

    def plain(self, room: HairRoom) -> torch.Tensor:
        """Strands traced along the segments as they are, signed downwards."""
        down = torch.where(self.segments.directions[:, 1:2] > 0, -1.0, 1.0)
        signed = replace(self.segments, directions=down * self.segments.directions)
        flow = hair_flow(room, signed, self.roots, self.normals, CONFIG)
        return trace_hair(flow, self.roots, self.normals, CONFIG.trace).points


@pytest.fixture(scope="module")
def curly() -> Photographed:
    axes = hanging_axes(STRANDS)
    normals = torch.nn.functional.normalize(axes[:, 0], dim=-1)
    distance = SignedDistanceGrid.build(head(), 0.005, 0.05)
    return Photographed(curled(axes, normals, Locks.drawn(axes[:, 0], 0.014), TRUE, distance))


class Traced(NamedTuple):
    """First strands of the curly hair, and what their tracing found, said and counted."""

    found: FoundCurls | None
    strands: torch.Tensor
    said: list[str]
    loops: list[Loop]


@pytest.fixture(scope="module")
def traced(curly: Photographed, tmp_path_factory: pytest.TempPathFactory) -> Traced:
    folder = tmp_path_factory.mktemp("curly") / "ball"
    write_capture(folder)
    scalp = find_head(Capture.load(folder), None)
    roots = sample_roots(scalp, 800, torch.Generator().manual_seed(0))
    roots = roots.select(roots.position[:, 1] > 0.04)
    distance = SignedDistanceGrid.build(head(), 0.005, 0.05)
    found: list[FoundCurls | None] = []
    said: list[str] = []
    counted = CountedLoops()

    def kept(*arguments) -> FoundCurls | None:
        found.append(find_curls(*arguments))
        return found[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(first_strands, "find_curls", kept)
        feedback = Feedback(said.append, counted.track)
        random = torch.Generator().manual_seed(0)
        first = first_strands.trace_first_strands(
            scalp, curly.segments, curly.views, roots, CONFIG, distance, random, feedback
        )
    return Traced(found[-1], first.strands.points, said, counted.loops)


@pytest.fixture(scope="module")
def found(traced: Traced) -> FoundCurls | None:
    return traced.found


@pytest.mark.slow(seconds=30)
def test_curls_are_found_and_wound(curly, found):
    assert found is not None
    assert found.curl.turn == TRUE.turn
    assert found.curl.pitch == pytest.approx(TRUE.pitch, rel=0.25)
    assert found.curl.slope == pytest.approx(TRUE.slope, rel=0.4)
    distance = SignedDistanceGrid.build(head(), 0.005, 0.05)
    strands = curl_strands(found, curly.roots, curly.normals, distance, CONFIG).points
    assert strands.shape == (STRANDS, CONFIG.trace.points, 3)
    assert torch.allclose(strands[:, 0], curly.roots, atol=1e-5)
    assert (SignedDistanceIndex(head())(strands.reshape(-1, 3)).distance > -0.002).float().mean() > 0.99
    assert float(lengths(strands).median()) > 0.12


def test_axes_run_as_those_that_the_curls_were_wound_about(found):
    """Some segments lean otherwise; with these, half of the axes' directions would be off by more than 24 degrees."""
    assert found is not None
    axes = hanging_axes(STRANDS)[::10, 10:110]
    along, true = found.axes.at(axes.reshape(-1, 3)), directions(axes).reshape(-1, 3)
    cosine = torch.nn.functional.cosine_similarity(along, true, dim=-1)
    off = torch.rad2deg(cosine.clamp(-1, 1).acos())
    assert off.median() < 15
    assert off.quantile(0.9) < 30


@pytest.mark.slow(seconds=30)
def test_first_strands_of_curly_hair_curl_and_say_so(traced):
    (said,) = traced.said
    assert all(loop.complete for loop in traced.loops)
    # The flow along the segments and the hanging one; for every lean that is tried, a flow and a drawing of each size;
    # and the flow along the axes that these show.
    titles = [loop.title for loop in traced.loops]
    drawings = [loop.total for loop in traced.loops if loop.title == "drawing curls"]
    assert drawings == [2 * len(SLOPES) + len(PITCHES)] * len(drawings)
    assert len(drawings) >= 1
    flows = titles.count("spreading hair over its room")
    assert titles.count("smoothing growth directions") == flows
    assert flows == len(drawings) + 3
    assert said.startswith("curly hair: radius ")
    assert said.endswith("left-handed")
    radius, pitch = (float(number) / 1000 for number in re.findall(r"([\d.]+) mm", said))
    assert pitch == pytest.approx(TRUE.pitch, rel=0.25)
    assert radius == pytest.approx(TRUE.radius, rel=0.4)
    turning = torch.linalg.cross(segments(traced.strands)[:, :-1], segments(traced.strands)[:, 1:])
    # Curls turn on by more than half a circle every pitch; straight hair hardly turns at all.
    turned = (turning.norm(dim=-1) / segments(traced.strands)[:, 1:].square().sum(dim=-1)).sum(dim=1)
    assert turned.median() > math.pi * lengths(traced.strands).median() / TRUE.pitch / 2


@pytest.mark.usefixtures("shapes_unchecked")
@pytest.mark.slow(seconds=50)
def test_curls_combed_to_one_side_are_found():
    """Off a course that hangs, their segments lean by 23 degrees instead of 38."""
    axes = combed_around(hanging_axes(STRANDS), -2.5)
    normals = torch.nn.functional.normalize(axes[:, 0], dim=-1)
    distance = SignedDistanceGrid.build(head(), 0.005, 0.05)
    curly = Photographed(curled(axes, normals, Locks.drawn(axes[:, 0], 0.014), TRUE, distance))
    room = curly.room()
    leaning = leaning_segments(room, curly.segments, curly.roots, curly.normals, CONFIG)
    assert leaning is not None
    assert not leaning.strong
    found = find_curls(room, curly.segments, curly.views, curly.plain(room), curly.normals, SCALP, CONFIG)
    assert found is not None
    assert found.curl.turn == TRUE.turn
    assert found.curl.pitch == pytest.approx(TRUE.pitch, rel=0.25)
    assert found.curl.slope == pytest.approx(TRUE.slope, rel=0.4)


@pytest.mark.slow(seconds=30)
def test_locks_that_wave_either_way_are_found():
    """Their segments lean to both sides, so that only the photographs tell."""
    axes, waves = hanging_axes(STRANDS), Curl(0.004, 0.04, 0, 0.5)
    normals = torch.nn.functional.normalize(axes[:, 0], dim=-1)
    distance = SignedDistanceGrid.build(head(), 0.005, 0.05)
    wavy = Photographed(curled(axes, normals, Locks.drawn(axes[:, 0], 0.014), waves, distance))
    room = wavy.room()
    assert lean_off_gravity(room, wavy.segments).agreement < 0.7
    found = find_curls(room, wavy.segments, wavy.views, wavy.plain(room), wavy.normals, SCALP, CONFIG)
    assert found is not None
    assert found.curl.turn == 0
    assert found.curl.pitch == pytest.approx(waves.pitch, rel=0.3)
    assert found.curl.slope == pytest.approx(waves.slope, rel=0.5)


def test_straight_hair_has_no_curls():
    straight = Photographed(hanging_axes(STRANDS))
    room = straight.room()
    lean = lean_off_gravity(room, straight.segments)
    assert abs(math.degrees(lean.angle)) < 5
    assert lean.agreement > 0.9
    assert (
        find_curls(room, straight.segments, straight.views, straight.plain(room), straight.normals, SCALP, CONFIG)
        is None
    )


def in_noise(strands: torch.Tensor, axes: torch.Tensor, noise: float) -> Comparison:
    """Drawn strands in noise, in place of photographs, compared with axes."""
    clear = photographs(Photographed(strands).views)
    random, grain = torch.Generator().manual_seed(7), torch.Generator().manual_seed(8)
    noisy = [
        drawn_hair(strands, camera, random) + noise * torch.randn(SIDE, SIDE, generator=grain)
        for camera in clear.cameras
    ]
    return Comparison.along(axes, replace(clear, brightness=noisy))


@pytest.mark.slow(seconds=30)
def test_noise_is_measured_and_explains_why_straight_hair_leans():
    axes = hanging_axes(STRANDS)
    for noise, expected in ((0.05, 0.0), (0.25, 0.25)):
        comparison = in_noise(axes, axes, noise)
        found = comparison.noise()
        assert found == pytest.approx(expected, rel=0.2)
    plainly, in_as_much = (comparison.of(axes, each).lean_difference(comparison.seen) for each in (0.0, found))
    assert in_as_much < 0.8 * plainly


@pytest.mark.slow(seconds=30)
def test_waves_are_told_from_noise():
    axes, waves = hanging_axes(STRANDS), Curl(0.004, 0.04, 0, 0.5)
    normals = torch.nn.functional.normalize(axes[:, 0], dim=-1)
    distance = SignedDistanceGrid.build(head(), 0.005, 0.05)
    wavy = curled(axes, normals, Locks.drawn(axes[:, 0], 0.014), waves, distance)
    comparison = in_noise(wavy, axes, 0.15)
    noise = comparison.noise()
    assert noise > 0
    plainly, in_as_much = (comparison.of(axes, each).lean_difference(comparison.seen) for each in (0.0, noise))
    assert plainly > WAVY
    assert in_as_much > OF_NOISE * plainly


@pytest.mark.usefixtures("shapes_unchecked")
@pytest.mark.slow(seconds=50)
@pytest.mark.parametrize(("twist", "strong"), [(6.0, True), (4.0, False)])
def test_straight_hair_combed_to_one_side_has_no_curls(twist, strong):
    """Segments that lean like those of curls, but photographs that show straight streaks."""
    combed = Photographed(combed_around(hanging_axes(STRANDS), twist))
    room = combed.room()
    leaning = leaning_segments(room, combed.segments, combed.roots, combed.normals, CONFIG)
    assert leaning is not None
    assert leaning.strong == strong
    assert find_curls(room, combed.segments, combed.views, combed.plain(room), combed.normals, SCALP, CONFIG) is None


def test_nothing_is_searched_without_masks_or_if_switched_off(curly):
    room = curly.room()
    off = replace(CONFIG, curls=replace(CONFIG.curls, find=False))
    scalp = curly.roots[:, None], curly.normals
    assert find_curls(room, curly.segments, curly.views, *scalp, SCALP, off) is None
    assert find_curls(replace(room, masked=False), curly.segments, curly.views, *scalp, SCALP, CONFIG) is None
