"""The initial strands: traced through the flow of the hair; and the shape texture that holds their latents."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.fitting.curls.curl_search import FoundCurls, curl_strands, find_curls
from neural_strands.flow.field import FlowField
from neural_strands.flow.hair_flow import InitialConfig, hair_flow, hair_masks, hair_room
from neural_strands.flow.hull import HullConfig, hairy_points
from neural_strands.flow.seen_roots import seen_roots
from neural_strands.flow.tracing import TracedStrands, trace_hair
from neural_strands.foundation.progress import Feedback, Track, untracked
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.views import Views
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.raster.texture import sample_texture
from neural_strands.scalp.blue_noise import throw_darts
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import Roots, attach_roots, sample_roots

ABOVE_ROOT = 0.003
"""Height above a root at which the views are tested for hair, metres."""
TRIED = 4
"""Segment points to follow back to the scalp for each root that is to be found there: many lead to the same places."""
CLOSEST = 0.4
"""Smallest distance of the roots found there from each other and from the others, in mean distances of all roots."""
LEAST_HAIRY = 0.3
"""Least share of the scalp that the masks of its own hair cover."""


@dataclass(frozen=True)
class FirstStrands:
    """Strands from which a fit starts.

    Attributes:
        roots: where they start, in random order.
        strands: one for each root.
    """

    roots: Roots
    strands: TracedStrands


@dataclass(frozen=True)
class Course:
    """How the hair runs.

    Attributes:
        flow: directions of the hair along the segments as they are.
        curls: the curls or waves that the photographs show, None for straight hair.
    """

    flow: FlowField
    curls: FoundCurls | None


def hair_roots(head: Head, count: int, views: Views, config: HullConfig, generator: torch.Generator) -> Roots:
    """Sample roots over the scalp, except where a view shows it bare: a head's chart may be larger than its hair.

    If the views leave less than `LEAST_HAIRY` of the scalp, masks and head do not belong together, and every root is
    kept.

    Args:
        head: mesh and chart, on the device of the views.
        count: number of roots, which are returned on the CPU.
        views: with hair masks, if there are any.
        config: how strictly a view declares a place bare.
        generator: draws the roots.
    """
    # Drawn on the CPU, so that they are the same on every device.
    scalp, device = head.to("cpu"), head.mesh.vertices.device
    roots = sample_roots(scalp, count, generator)
    if not any(views.has_hair_mask):
        return roots
    index = MeshIndex(head.mesh)
    before = [HeadView.of(camera, index) for camera in views.cameras]

    def hairy(some: Roots) -> Bool[Tensor, " root"]:
        points = (some.position + ABOVE_ROOT * some.normal).to(device)
        return hairy_points(points, hair_masks(views, before), config, views.witnesses).cpu()

    kept = hairy(roots)
    share = float(kept.float().mean())
    if share == 1 or share < LEAST_HAIRY:
        return roots
    many = count
    while len(found := roots.select(kept)) < count:
        many += max(round((count - len(found)) / share), 1)
        roots = sample_roots(scalp, many, generator)
        kept = hairy(roots)
    return found.select(torch.arange(count))


def trace_first_strands(
    head: Head,
    segments: LineSegments,
    views: Views,
    roots: Roots,
    config: InitialConfig,
    distance: SignedDistanceGrid,
    generator: torch.Generator,
    feedback: Feedback | None = None,
) -> FirstStrands:
    """Trace strands through the flow of the hair; where the photographs show curls, curl them.

    A share of the roots moves to where hair begins that the photographs show.

    Args:
        head: mesh and chart, on the device of the segments.
        segments: line segments of the hair, signed from root to tip.
        views: the views from which the segments were reconstructed.
        roots: spread over the scalp.
        config: settings of the initial strands.
        distance: signed distance to the head.
        generator: draws the roots that move, on the CPU.
        feedback: receives the progress of each stage, and what kind of curls were found.
    """
    feedback = feedback or Feedback()
    course = find_course(head, segments, views, roots, config, distance, feedback.track)
    found, flow = course.curls, course.flow if course.curls is None else course.curls.axes
    roots = with_seen_roots(head, segments, flow, roots, config, distance, generator)
    if found is None:
        return FirstStrands(roots, trace_hair(flow, roots.position, roots.normal, config.trace))
    curl = found.curl
    kind, turn = {1: ("curly", "right-handed"), -1: ("curly", "left-handed"), 0: ("wavy", "either way")}[curl.turn]
    feedback.say(f"{kind} hair: radius {1e3 * curl.radius:.1f} mm, {1e3 * curl.pitch:.0f} mm a turn, {turn}")
    return FirstStrands(roots, curl_strands(found, roots.position, roots.normal, distance, config))


def with_seen_roots(
    head: Head,
    segments: LineSegments,
    flow: FlowField,
    roots: Roots,
    config: InitialConfig,
    distance: SignedDistanceGrid,
    generator: torch.Generator,
) -> Roots:
    """Move `config.seen_share` of the roots to where hair begins that the photographs show; in random order.

    Args:
        head: mesh and chart, on the device of the segments.
        segments: line segments of the hair, signed from root to tip.
        flow: directions of the hair.
        roots: spread over the scalp.
        config: settings of the initial strands.
        distance: signed distance to the head.
        generator: draws the roots that move, on the CPU.
    """
    confident = segments.select(segments.confidence >= config.flow.least_confidence)
    wanted = round(config.seen_share * len(roots))
    seen = seen_roots(flow, confident, roots.position, TRIED * wanted, distance, config.trace, generator)
    # Texels cannot tell apart strands whose roots are closer than this.
    gap = CLOSEST * math.sqrt(head.scalp_area / len(roots))
    seen = seen[throw_darts(seen, gap)[:wanted]]
    beside, _ = nearest(roots.position, seen, radius=gap)
    draw = torch.rand(len(roots), generator=generator, device=generator.device).to(beside)
    leaving_last = torch.where(beside.isfinite(), draw - 1, draw).argsort()
    mixed = torch.randperm(len(roots), generator=generator, device=generator.device).to(seen.device)
    found = attach_roots(head.to("cpu"), seen.cpu()).to(seen.device)
    return roots.select(leaving_last[len(seen) :]).joined(found).select(mixed)


def find_course(
    head: Head,
    segments: LineSegments,
    views: Views,
    roots: Roots,
    config: InitialConfig,
    distance: SignedDistanceGrid | None = None,
    track: Track = untracked,
) -> Course:
    """Find out how the hair runs along the segments as they are, and whether it is curly.

    Args:
        head: mesh and chart, on the device of the segments.
        segments: line segments of the hair, signed from root to tip.
        views: the views from which the segments were reconstructed.
        roots: spread over the scalp.
        config: settings of the initial strands.
        distance: signed distance to the head, if the caller has sampled it already; only saves time.
        track: shows the progress of each stage.
    """
    room = hair_room(segments, views, head.mesh, roots.position, config, distance, track)
    flow = hair_flow(room, segments, roots.position, roots.normal, config, track)
    plain = trace_hair(flow, roots.position, roots.normal, config.trace)
    found = find_curls(room, segments, views, plain.points, roots.normal, head.scalp_faces, config, track)
    return Course(flow, found)


def texture_from_latents(
    uv: Float[Tensor, "root 2"], latents: Float[Tensor, "root latent"], size: int, sweeps: int = 10
) -> Float[Tensor, "{size} {size} latent"]:
    """Fit a texture whose bilinear samples at the roots are their latents; gaps take the latent of the nearest root.

    Texels start as the latent of their nearest root; sweeps of simultaneous algebraic reconstruction (SIRT) then
    distribute the error of the samples to the four texels of each root.
    """
    places = torch.cartesian_prod(*(2 * [torch.arange(size, device=uv.device)])).flip(-1)
    centres = (places + 0.5) / size
    flat = torch.nn.functional.pad(torch.cat([uv, centres.to(uv)]), (0, 1))
    _, nearest_root = nearest(flat[len(uv) :], flat[: len(uv)], radius=2.0)
    texture = latents[nearest_root].reshape(size, size, -1).requires_grad_()
    ones = torch.ones(size, size, 1, device=uv.device, requires_grad=True)
    share = torch.autograd.grad(sample_texture(ones, uv).sum(), ones)[0].clamp(min=1e-6)
    for _ in range(sweeps):
        error = latents - sample_texture(texture, uv)
        (back,) = torch.autograd.grad((sample_texture(texture, uv) * error.detach()).sum(), texture)
        texture = (texture + back / share).detach().requires_grad_()
    return texture.detach()
