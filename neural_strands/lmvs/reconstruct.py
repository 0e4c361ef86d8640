"""Line-based multi-view stereo from end to end: views in, line segments out (paper, Data Preparation)."""

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
import warp as wp

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.lmvs.bounds import (
    Carver,
    Hull,
    Region,
    Sight,
    find_region,
    head_distance,
    not_seen_empty,
    ray_bounds,
    sight_of,
    warp_mesh,
)
from neural_strands.lmvs.chains import ChainConfig, grow_chains
from neural_strands.lmvs.consistency import OrientedPoints, confirmations, join_points, line_points
from neural_strands.lmvs.fusion import add_guesses, fill_gaps
from neural_strands.lmvs.identity import inputs_digest
from neural_strands.lmvs.orientation import OrientationConfig
from neural_strands.lmvs.patchmatch import LineMap, PatchMatchConfig, match_lines, on_grid
from neural_strands.lmvs.views import View
from neural_strands.lmvs.work import Work

log = logging.getLogger(__name__)

GAP = 4.0
"""Cells, in pixel footprints, that are filled where hair is to be complete."""
SCALE = 5.0
"""A head this many times larger or smaller than the hair is in another unit."""


@dataclass(frozen=True)
class LmvsConfig:
    """Everything that can be set; lengths follow the pixel footprint, so defaults hold at any scale."""

    orientation: OrientationConfig = field(default_factory=OrientationConfig)
    """2D orientation."""
    patchmatch: PatchMatchConfig = field(default_factory=PatchMatchConfig)
    """Lines of a view."""
    chains: ChainConfig = field(default_factory=ChainConfig)
    """Segments."""
    least_baseline: float = 8.0
    """Smallest angle between neighbour views, seen from the hair, degrees."""
    thickness: float = 0.3
    """How deep behind the hull's surface hair is looked for, as a share of the radius that the hair is seen in."""
    voxel: float = 3.0
    """Voxel of the hull, pixel footprints."""
    confirming: float = 1.4
    """Other views that must confirm a line; each counts from 1 (the same line) to 0 (off by the limits below)."""
    distance: float = 6.0
    """Within what distance, pixel footprints."""
    angle: float = 25.0
    """Within what angle, degrees."""
    gap: float | None = None
    """Cells of this size, pixel footprints, that hold no confirmed line take the best unconfirmed one (see `GAP`); None
    for none. Where there are no masks they take none either, as much that is not hair is looked at."""


@dataclass(frozen=True)
class _Scene:
    """What every view's matching shares."""

    work: Work
    region: Region
    hull: Hull
    mesh: wp.Mesh | None
    sights: list[Sight]
    footprint: float
    masked: bool


def reconstruct(
    views: Sequence[View],
    head: Mesh | None,
    config: LmvsConfig,
    generator: torch.Generator,
    folder: Path | None = None,
    track: Callable[[Iterable[int], str, int], Iterable[int]] = lambda items, _text, _total: items,
) -> LineSegments:
    """Reconstruct line segments, directions unsigned.

    Args:
        views: two or more; those that show no hair are left out with a warning.
        head: the head in the same frame, if it is known: hair is not looked for inside.
        config: settings.
        generator: of every random choice.
        folder: keeps each view's lines, so that a stopped run goes on, unless photographs, cameras, head or
            settings have changed, which is said; None keeps nothing.
        track: shows progress over an iterable, given what is done and how many there are.

    Raises:
        InputError: fewer than two views show hair.
    """
    if len(views) < 2:
        raise InputError(f"expected at least two views to match lines between, came {len(views)}; add photographs.")
    with TemporaryDirectory() as temporary:
        seed = int(torch.randint(0, 2**30, (1,), generator=generator))
        work = Work(folder or Path(temporary), views, config.orientation)
        if folder is not None:
            work.keep_only(inputs_digest(views, head, _of_views(config, seed)))
        good = [i for i in track(range(len(views)), "orientation", len(views)) if work.prepare(i)]
        good = _outside_head([view.camera for view in views], good, head)
        if len(good) < 2:
            raise InputError(f"expected hair in at least two views, found it in {len(good)}; look at images and masks.")
        scene = _survey(views, good, head, config, work)
        cameras = [view.camera for view in views]
        for i in track(good, "lines", len(good)):
            if not work.has_lines(i):
                neighbours = _neighbours(cameras, good, i, scene.region, config.least_baseline)
                work.save_lines(i, _match(work, scene, i, neighbours, config, seed + 1000 * i))
        confirmed, guesses = zip(
            *(_fuse(work, cameras, good, i, scene, config) for i in track(good, "fusion", len(good))), strict=True
        )
    cloud = join_points(confirmed)
    segments = grow_chains(cloud, scene.footprint, config.chains, generator)
    if config.gap is None:
        return segments
    cell = config.gap * scene.footprint
    return add_guesses(segments, fill_gaps(join_points(guesses), cloud, cell), 0.5 * cell)


def _of_views(config: LmvsConfig, seed: int) -> list[object]:
    """The settings that a view's lines depend on; fusion is done anew at every run."""
    return [config.orientation, config.patchmatch, config.least_baseline, config.thickness, config.voxel, seed]


def _outside_head(cameras: Sequence[Camera], good: list[int], head: Mesh | None) -> list[int]:
    """Leave out, with a warning, the views whose camera lies inside the head."""
    if head is None or not good:
        return good
    centres = torch.stack([cameras[i].position for i in good])
    inside = (signed_distance(centres, head).distance < 0).tolist()
    for i, wrong in zip(good, inside, strict=True):
        if wrong:
            log.warning("%s: its camera lies inside the head; the view is left out.", cameras[i].name or f"view {i}")
    return [i for i, wrong in zip(good, inside, strict=True) if not wrong]


def _check_scale(region: Region, head: Mesh | None) -> None:
    """Refuse a head that is not where the cameras see hair, or of another scale.

    Raises:
        InputError: it is not.
    """
    if head is None:
        return
    low, high = head.vertices.amin(dim=0), head.vertices.amax(dim=0)
    size, away = 0.5 * float((high - low).norm()), float((0.5 * (low + high) - region.centre).norm())
    if away > size + region.radius or not 1 / SCALE < region.radius / size < SCALE:
        raise InputError(
            f"expected the head where the cameras see the hair (radius {region.radius:.3g} m), came a head of radius "
            f"{size:.3g} m, {away:.3g} m away; bring head and cameras to one scale and frame."
        )


def _survey(views: Sequence[View], good: list[int], head: Mesh | None, config: LmvsConfig, work: Work) -> _Scene:
    """Find where the hair is, and carve its hull."""
    cameras = [views[i].camera for i in good]
    masked = any(views[i].load_mask is not None for i in good)
    region = find_region(cameras, [work.features(i).box for i in good], masked)
    _check_scale(region, head)
    footprints = [camera.footprint(float((camera.position - region.centre).norm())) for camera in cameras]
    footprint = float(torch.tensor(footprints).median())
    mesh = None if head is None else warp_mesh(head)
    carver = Carver(region, config.voxel * footprint)
    sights = [sight_of(views[i].camera, work.features(i).silhouette, mesh) for i in good]
    for sight in sights:
        carver.add(sight)
    return _Scene(work, region, carver.hull(), mesh, sights, footprint, masked)


def _neighbours(cameras: Sequence[Camera], good: list[int], i: int, region: Region, least: float) -> list[int]:
    """The views nearest to a view in angle, but not nearer than the least baseline."""
    direction = torch.stack(
        [torch.nn.functional.normalize(camera.position - region.centre, dim=0) for camera in cameras]
    )
    angle = torch.rad2deg(torch.arccos((direction @ direction[i]).clamp(-1, 1)))
    chosen = sorted((float(angle[j]), j) for j in good if j != i and float(angle[j]) >= least)
    return [j for _, j in chosen[:8]]


def _match(work: Work, scene: _Scene, i: int, neighbours: list[int], config: LmvsConfig, seed: int) -> LineMap:
    """Lines of one view."""
    reference = work.features(i)
    pixel = torch.nonzero(reference.hair).flip(1)
    stride = min(level.stride for level in config.patchmatch.levels)
    pixel = pixel[on_grid(pixel, stride, config.patchmatch)]
    rays = reference.camera.rays(pixel.float() + 0.5)
    settings, thickness = config.patchmatch, config.thickness * scene.region.radius
    if not scene.masked:
        # No hull: the whole ball is searched, and lying deep in it says nothing.
        settings, thickness = replace(settings, sink=0.0), 2 * scene.region.radius
    head = head_distance(reference.camera, rays, scene.mesh)
    bounds = ray_bounds(reference.camera, rays, head, scene.hull, scene.region, thickness)
    bounds, pixel = bounds.select(bounds.near > 0), pixel[bounds.near > 0]
    others = [work.features(j) for j in neighbours]
    return match_lines(reference, others, pixel, bounds, thickness, settings, seed)


def _fuse(
    work: Work, cameras: Sequence[Camera], good: list[int], i: int, scene: _Scene, config: LmvsConfig
) -> tuple[OrientedPoints, OrientedPoints]:
    """Lines of a view that other views confirm, and guesses: lines that they do not, the best in each cell."""
    lines = work.lines(i)
    points = line_points(cameras[i], lines)
    kept = not_seen_empty(points, scene.sights)
    points, directions = points[kept], lines.direction[kept]
    near = _neighbours(cameras, good, i, scene.region, 0.0)
    others = [(cameras[j], work.lines(j)) for j in near]
    stride = min(level.stride for level in config.patchmatch.levels)
    distance, angle = config.distance * scene.footprint, math.radians(config.angle)
    votes = confirmations(points, directions, others, distance, angle, stride)
    weight = (1 - lines.cost[kept]).clamp(0.05, 1) * (votes / len(near)).sqrt().clamp(max=1)
    cloud = OrientedPoints(points, directions, weight, torch.full_like(weight, i, dtype=torch.int64))
    sure = votes >= min(config.confirming, 0.5 * len(near))
    confirmed = cloud.select(sure)
    if config.gap is None or not scene.masked:
        return confirmed, cloud.select(torch.zeros_like(sure))
    return confirmed, fill_gaps(cloud.select(~sure), confirmed, config.gap * scene.footprint)
