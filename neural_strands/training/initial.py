"""The first guess of the shape texture: strands traced through the flow, then encoded by the prior."""

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.flow.field import FlowConfig, FlowField, diffuse_directions
from neural_strands.flow.grid import VoxelGrid
from neural_strands.flow.hull import HullConfig, covered_volume, hair_hull
from neural_strands.flow.tracing import TraceConfig, trace_strands
from neural_strands.geometry.frames import to_local
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.prior.vae import StrandPrior
from neural_strands.scalp.roots import Roots
from neural_strands.training.masked_views import MaskedViews


@dataclass(frozen=True)
class InitialConfig:
    """How first strands are found."""

    flow: FlowConfig = field(default_factory=FlowConfig)
    """The volume of growth directions."""
    hull: HullConfig = field(default_factory=HullConfig)
    """Where hair can be."""
    trace: TraceConfig = field(default_factory=TraceConfig)
    """Streamlines from the scalp."""
    refine_steps: int = 0
    """Gradient steps on each latent after the encoder."""


def hair_flow(segments: LineSegments, views: MaskedViews, head: Mesh, roots: Roots, config: InitialConfig) -> FlowField:
    """Directions and extent of the hair, from segments, masks (where there are any) and the scalp."""
    known = torch.cat([segments.points, roots.position])
    grid = VoxelGrid.around(known, config.flow.spacing, config.flow.margin)
    if views.masked:
        domain = hair_hull(grid, views, head, config.hull)
    else:
        domain = covered_volume(grid, segments.points, head, config.hull)
    return diffuse_directions(grid, domain, segments, roots.position, roots.normal, config.flow)


def flow_latents(
    field: FlowField, roots: Roots, prior: StrandPrior, config: TraceConfig
) -> tuple[Float[Tensor, "root latent"], Float[Tensor, "root point 3"]]:
    """Trace a strand from every root and encode it; returns the latents and the traced strands in world metres."""
    strands = trace_strands(field, roots.position, roots.normal, config)
    return prior.encode(to_local(strands, roots.position, roots.frame)), strands
