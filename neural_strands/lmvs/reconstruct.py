"""Line-based multi-view stereo from end to end: from views to line segments (paper, "Data Preparation")."""

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.geometry.views import Views
from neural_strands.geometry.visual_hull import HeadView, Silhouette, head_distance, possible_points, visual_hull
from neural_strands.lmvs.chains import ChainConfig, grow_chains
from neural_strands.lmvs.connected_hair import large_masses
from neural_strands.lmvs.consistency import LineCloud, confirmations, join_points, line_points
from neural_strands.lmvs.fusion import add_guesses, best_share, fill_gaps, share_reached
from neural_strands.lmvs.inputs_digest import inputs_digest
from neural_strands.lmvs.kernels.ribbons import MOST_NEIGHBOURS
from neural_strands.lmvs.orientation import OrientationConfig
from neural_strands.lmvs.patchmatch import LineMap, PatchMatchConfig, match_lines, on_grid
from neural_strands.lmvs.region import Region, find_region
from neural_strands.lmvs.scale import check_head_size, check_scene, in_metres, of_one_scale
from neural_strands.lmvs.search_range import SmoothHull, ray_bounds
from neural_strands.lmvs.view_cache import ViewCache

log = logging.getLogger(__name__)

NOBODY = 0.1
"""Votes added to every guess, so that the matching cost ranks those without any vote."""

Complete = Literal["auto", "always", "never"]
"""When gaps are filled with guesses."""


@dataclass(frozen=True)
class LmvsConfig:
    """All settings of the stereo; most lengths are in pixel footprints, so that the defaults hold at any scale."""

    orientation: OrientationConfig = field(default_factory=OrientationConfig)
    """Orientation in the images."""
    patchmatch: PatchMatchConfig = field(default_factory=PatchMatchConfig)
    """Matching the lines of a view."""
    chains: ChainConfig = field(default_factory=ChainConfig)
    """Joining lines into segments."""
    least_baseline: Annotated[float, Between(0, 180)] = 8.0
    """Smallest angle between neighbour views, seen from the hair, degrees."""
    thickness: Annotated[float, Between(0.001, 10)] = 0.3
    """Search depth behind the hull's surface, as a share of the radius of the hair's region."""
    voxel: Annotated[float, Between(0.5, 1000)] = 3.0
    """Voxel of the hull, pixel footprints."""
    confirming: Annotated[float, Between(0, 100)] = 2.0
    """Number of other views that must confirm a line; each counts from 1 (the same line) to 0 (at the limits below)."""
    distance: Annotated[float, Between(0.01, 1000)] = 6.0
    """Largest distance between lines that confirm each other, pixel footprints."""
    angle: Annotated[float, Between(0, 90)] = 25.0
    """Largest angle between lines that confirm each other, degrees."""
    complete: Complete = "auto"
    """Whether lines that no other view confirms fill the gaps between those that are. `auto`: if confirmed segments
    reach less than `filled` of the space for hair. Without masks they never do, because much of what is seen is not
    hair."""
    filled: Annotated[float, Between(0, 1)] = 1 / 3
    """Share of the space that masks and head leave for hair that confirmed segments should reach."""
    reach: Annotated[float, Between(1e-6, 1)] = 3e-3
    """Distance up to which a segment reaches a position, metres: the largest thickness of hair above it."""
    gap: Annotated[float, Between(0.1, 1000)] = 3.0
    """Cells of this size, pixel footprints, that hold no confirmed line take the best unconfirmed one."""
    dropped: Annotated[float, Between(0, 1)] = 0.25
    """Share of these guesses that is dropped, the worst first."""
    apart: Annotated[float, Between(0, 1)] = 0.03
    """Without masks: distance beyond which masses of segments are separate, as a share of the radius of the hair's
    region."""
    speck: Annotated[float, Between(0, 1)] = 0.15
    """Without masks: a mass with less than this share of the points of the largest is not hair."""


@dataclass(frozen=True)
class _Scene:
    """Data shared by the matching of all views: hull, head and silhouettes."""

    region: Region
    hull: SmoothHull
    head: MeshIndex | None
    silhouettes: list[Silhouette]
    witnesses: int
    footprint: float
    masked: bool


def reconstruct(
    views: Views,
    head: Mesh | None,
    config: LmvsConfig,
    generator: torch.Generator,
    folder: Path | None = None,
    track: Callable[[Iterable[int], str, int], Iterable[int]] = lambda items, _text, _total: items,
) -> LineSegments:
    """Reconstruct line segments; their directions are unsigned.

    Args:
        views: two or more; those that show no hair are skipped with a warning.
        head: the head in the same frame, if known; hair is not searched inside it.
        config: settings.
        generator: source of every random choice.
        folder: stores each view's lines, so that a stopped run continues; if photographs, cameras, head or settings
            have changed, this is reported and it starts anew. None stores nothing.
        track: shows progress over an iterable, given a label and the number of items.

    Raises:
        InputError: fewer than two views show hair, or the head has another scale.
    """
    if len(views) < 2:
        raise InputError(f"expected at least two views to match lines between, found {len(views)}; add photographs.")
    check_head_size(head)
    with TemporaryDirectory() as temporary:
        seed = int(torch.randint(0, 2**30, (1,), generator=generator))
        cache = ViewCache(folder or Path(temporary), views, config.orientation)
        if folder is not None:
            cache.keep_only(inputs_digest(views, head, _of_views(config, seed)))
        good = [i for i in track(range(len(views)), "orientation", len(views)) if cache.prepare(i)]
        good = _well_placed(views.cameras, good, head, cache)
        if len(good) < 2:
            raise InputError(f"expected hair in at least two views, found it in {len(good)}; check images and masks.")
        scene = _survey(views, good, head, config, cache)
        cameras = views.cameras
        for i in track(good, "lines", len(good)):
            if not cache.has_lines(i):
                neighbours = _neighbours(cameras, good, i, scene.region, config.least_baseline)
                cache.save_lines(i, _match(cache, scene, i, neighbours, config, seed + 1000 * i))
        parts = [_fuse(cache, cameras, good, i, scene, config) for i in track(good, "fusion", len(good))]
    confirmed, guesses = (join_points(kind) for kind in zip(*parts, strict=True))
    segments = grow_chains(confirmed, scene.footprint, config.chains, generator)
    if not scene.masked:
        return large_masses(segments, config.apart * scene.region.radius, config.speck)
    if not _gaps_wanted(scene, head, segments, config):
        return segments
    guesses = best_share(fill_gaps(guesses, confirmed, config.gap * scene.footprint), 1 - config.dropped)
    return add_guesses(segments, guesses, config.chains.step * scene.footprint)


def _gaps_wanted(scene: _Scene, head: Mesh | None, segments: LineSegments, config: LmvsConfig) -> bool:
    """Whether guesses should complete confirmed segments; logs the decision if it is `auto`."""
    if config.complete != "auto":
        return config.complete == "always"
    if not in_metres(scene.region):
        return False
    share = share_reached(_hair_space(scene.hull, head), segments.points, config.reach)
    if share < config.filled:
        log.warning(
            "Segments that several views confirm come within %.0f mm of %.0f %% of the space for hair, less than "
            "%.0f %%: lines that one view alone sees fill the gaps.",
            *(1e3 * config.reach, 100 * share, 100 * config.filled),
        )
    return share < config.filled


def _hair_space(hull: SmoothHull, head: Mesh | None, most: int = 60_000) -> Float[Tensor, "node 3"]:
    """Points spread evenly over the hull outside the head; at most `most`, counted before those inside are removed."""
    nodes = hull.nodes()[:most]
    return nodes if head is None else nodes[signed_distance(nodes, head).distance > 0]


def _of_views(config: LmvsConfig, seed: int) -> list[object]:
    """The settings on which the stored lines of a view depend; fusion is repeated in every run."""
    return [config.orientation, config.patchmatch, config.least_baseline, config.thickness, config.voxel, seed]


def _well_placed(cameras: Sequence[Camera], good: list[int], head: Mesh | None, cache: ViewCache) -> list[int]:
    """Skip, with a warning, the views whose camera lies inside the head or has another unit than the others."""
    if head is not None and good:
        centres = torch.stack([cameras[i].position for i in good])
        inside = (signed_distance(centres, head).distance < 0).tolist()
        for i, wrong in zip(good, inside, strict=True):
            if wrong:
                log.warning(
                    "%s: its camera lies inside the head; the view is left out.", cameras[i].name or f"view {i}"
                )
        good = [i for i, wrong in zip(good, inside, strict=True) if not wrong]
    if len(good) < 2:
        return good
    kept = of_one_scale([cameras[i] for i in good], [cache.features(i).box for i in good])
    return [i for i, fine in zip(good, kept, strict=True) if fine]


def _survey(views: Views, good: list[int], head: Mesh | None, config: LmvsConfig, cache: ViewCache) -> _Scene:
    """Locate the hair and carve its hull."""
    cameras = [views.cameras[i] for i in good]
    masked = any(views.has_hair_mask[i] for i in good)
    region = find_region(cameras, [cache.features(i).box for i in good], masked)
    check_scene(region, head)
    footprints = [camera.footprint(float((camera.position - region.centre).norm())) for camera in cameras]
    footprint = float(torch.tensor(footprints).median())
    index = None if head is None else MeshIndex(head)
    silhouettes = [Silhouette(HeadView.of(views.cameras[i], index), cache.features(i).silhouette) for i in good]
    grid = region.grid(config.voxel * footprint)
    hull = SmoothHull.of(grid, visual_hull(grid, silhouettes, region.holds(grid), views.witnesses))
    return _Scene(region, hull, index, silhouettes, views.witnesses, footprint, masked)


def _neighbours(cameras: Sequence[Camera], good: list[int], i: int, region: Region, least: float) -> list[int]:
    """The views nearest to a view in angle, excluding those below the least baseline, `least` degrees."""
    direction = torch.stack(
        [torch.nn.functional.normalize(camera.position - region.centre, dim=0) for camera in cameras]
    )
    angle = torch.rad2deg(torch.arccos((direction @ direction[i]).clamp(-1, 1)))
    chosen = sorted((float(angle[j]), j) for j in good if j != i and float(angle[j]) >= least)
    return [j for _, j in chosen[:MOST_NEIGHBOURS]]


def _match(cache: ViewCache, scene: _Scene, i: int, neighbours: list[int], config: LmvsConfig, seed: int) -> LineMap:
    """Match the lines of one view."""
    reference = cache.features(i)
    pixel = torch.nonzero(reference.hair).flip(1)
    stride = min(level.stride for level in config.patchmatch.levels)
    pixel = pixel[on_grid(pixel, stride, config.patchmatch)]
    rays = reference.camera.rays(pixel.float() + 0.5)
    settings, thickness = config.patchmatch, config.thickness * scene.region.radius
    if not scene.masked:
        # Without a hull the whole sphere is searched, and depth within it carries no prior.
        settings, thickness = replace(settings, sink=0.0), 2 * scene.region.radius
    head = head_distance(reference.camera, rays, scene.head)
    bounds = ray_bounds(reference.camera, rays, head, scene.hull, scene.region, thickness)
    bounds, pixel = bounds.select(bounds.near > 0), pixel[bounds.near > 0]
    others = [cache.features(j) for j in neighbours]
    return match_lines(reference, others, pixel, bounds, thickness, settings, seed)


def _fuse(
    cache: ViewCache, cameras: Sequence[Camera], good: list[int], i: int, scene: _Scene, config: LmvsConfig
) -> tuple[LineCloud, LineCloud]:
    """Split a view's lines into those that other views confirm and guesses: the best unconfirmed line per cell."""
    lines = cache.lines(i)
    points = line_points(cameras[i], lines)
    kept = possible_points(points, scene.silhouettes, scene.witnesses)
    points, directions = points[kept], lines.direction[kept]
    near = _neighbours(cameras, good, i, scene.region, 0.0)
    others = [(cameras[j], cache.lines(j)) for j in near]
    stride = min(level.stride for level in config.patchmatch.levels)
    distance, angle = config.distance * scene.footprint, math.radians(config.angle)
    votes = confirmations(points, directions, others, distance, angle, stride)
    fit = (1 - lines.cost[kept]).clamp(0.05, 1)
    view = torch.full_like(fit, i, dtype=torch.int64)
    sure = votes >= min(config.confirming, 0.5 * len(near))
    confirmed = LineCloud(points, directions, fit * (votes / len(near)).sqrt().clamp(max=1), view).select(sure)
    # The vote added to all lines lets the matching cost rank those without other votes.
    guesses = LineCloud(points, directions, fit * ((votes + NOBODY) / len(near)).sqrt(), view).select(~sure)
    if config.complete == "never" or not scene.masked:
        return confirmed, guesses.select(view[:0])
    return confirmed, fill_gaps(guesses, confirmed, config.gap * scene.footprint)
