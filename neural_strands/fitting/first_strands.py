"""The initial shape texture: strands traced through the flow, then encoded by the prior."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.flow.conservation import ConservationConfig, conserve
from neural_strands.flow.field import FlowConfig, FlowField, diffuse_directions, grid_around
from neural_strands.flow.hull import HullConfig, covered_volume, hair_hull, hairy_points
from neural_strands.flow.tracing import TraceConfig, TracedStrands, trace_hair
from neural_strands.flow.unseen import UnseenConfig, guess_unseen, head_layer
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.frames import to_local
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.point_queries import nearest
from neural_strands.geometry.views import Views
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.prior.vae import StrandPrior
from neural_strands.raster.texture import sample_texture
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import Roots, sample_roots

VOXEL_BYTES = 180
"""Peak memory of `hair_flow`, bytes per voxel of its grid (152 and 181 measured)."""


ABOVE_ROOT = 0.003
"""Height above a root at which the views are tested for hair, metres."""
LEAST_HAIRY = 0.3
"""Least share of the scalp that the masks of its own hair cover."""


@dataclass(frozen=True)
class InitialConfig:
    """Settings of the initial strands."""

    flow: FlowConfig = field(default_factory=FlowConfig)
    """The volume of growth directions."""
    conservation: ConservationConfig = field(default_factory=ConservationConfig)
    """How the flow is made to conserve the number of strands."""
    hull: HullConfig = field(default_factory=HullConfig)
    """Where hair can be."""
    unseen: UnseenConfig = field(default_factory=UnseenConfig)
    """How hair that no view sees is continued from what is seen."""
    trace: TraceConfig = field(default_factory=TraceConfig)
    """Streamlines from the scalp."""


def flow_memory(points: Float[Tensor, "point 3"], config: FlowConfig) -> int:
    """Peak memory of `hair_flow` for hair and roots at these points, bytes."""
    return VOXEL_BYTES * grid_around(points, config.spacing, config.margin).count


def hair_flow(
    segments: LineSegments,
    views: Views,
    head: Mesh,
    roots: Roots,
    config: InitialConfig,
    distance: SignedDistanceGrid | None = None,
) -> FlowField:
    """Estimate directions and extent of the hair from segments, masks (where there are any) and the scalp.

    Args:
        segments: line segments, signed from root to tip.
        views: the views, with or without hair masks.
        head: mesh of the head.
        roots: roots on its scalp.
        config: settings of the initial strands.
        distance: signed distance to the head, if the caller has sampled it already; only saves time.
    """
    known = torch.cat([segments.points, roots.position])
    grid = grid_around(known, config.flow.spacing, config.flow.margin)
    index = MeshIndex(head)
    before = [HeadView.of(camera, index) for camera in views.cameras]
    masked = any(views.has_hair_mask)
    if masked:
        domain = hair_hull(grid, _hair_masks(views, before), head, config.hull, distance)
    else:
        domain = covered_volume(grid, segments.points, head, config.hull, distance)
    layer = head_layer(grid, before, head, config.unseen)
    domain, guess = guess_unseen(layer, grid, domain, segments, head, masked, config.unseen)
    smooth = diffuse_directions(grid, domain, segments, roots.position, roots.normal, config.flow, guess)
    return conserve(smooth, roots.position, roots.normal, config.hull.head_depth, config.conservation)


def _hair_masks(views: Views, before: Sequence[HeadView]) -> Iterator[tuple[HeadView, Float[Tensor, "height width"]]]:
    """The views that have a hair mask, each with the depth of the head in it."""
    for index, view in enumerate(before):
        mask = views.hair_mask(index) if views.has_hair_mask[index] else None
        if mask is not None:
            yield view, mask


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
        return hairy_points(points, _hair_masks(views, before), config).cpu()

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
    head: Head, segments: LineSegments, views: Views, count: int, config: InitialConfig, generator: torch.Generator
) -> TracedStrands:
    """Trace initial strands from a number of roots, without encoding them by a prior.

    Args:
        head: mesh and chart.
        segments: line segments of the hair, signed from root to tip.
        views: the views from which the segments were reconstructed.
        count: number of roots.
        config: settings of the initial strands.
        generator: draws the roots.
    """
    roots = hair_roots(head, count, views, config.hull, generator)
    flow = hair_flow(segments, views, head.mesh, roots, config)
    return trace_hair(flow, roots.position, roots.normal, config.trace)


def flow_latents(
    field: FlowField, roots: Roots, prior: StrandPrior, config: TraceConfig
) -> Float[Tensor, "root latent"]:
    """Trace a strand from every root and encode it by the prior."""
    strands = trace_hair(field, roots.position, roots.normal, config).points
    return prior.encode(to_local(strands, roots.position, roots.frame))


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
