"""The room of the hair and the flow of hanging hair, on a ball."""

import math

import pytest
import torch
from tiny_capture import RADIUS, ball, cameras, combed_strands, true_segments

from neural_strands.flow.field import FlowConfig, FlowField
from neural_strands.flow.hair_flow import (
    SKIN,
    HairRoom,
    InitialConfig,
    along_scalp,
    behind_segments,
    hair_room,
    hanging_flow,
)
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import segments
from neural_strands.geometry.views import Views
from neural_strands.raster.lines import rasterise_lines
from neural_strands.raster.triangles import rasterise_triangles

CONFIG = InitialConfig(flow=FlowConfig(spacing=0.003))


@pytest.fixture(scope="module")
def hair() -> torch.Tensor:
    return combed_strands(4000)


@pytest.fixture(scope="module")
def room(hair) -> HairRoom:
    mesh = Mesh(torch.from_numpy(ball().vertices).float(), torch.from_numpy(ball().faces).long())
    seen = [camera.resized(256, 256) for camera in cameras(12)]
    masks = []
    for camera in seen:
        body = rasterise_triangles(mesh.vertices, mesh.faces, camera)
        masks.append((rasterise_lines(hair, camera, body.depth).segment >= 0).float())
    views = Views(tuple(seen), (True,) * len(seen), lambda index, part: masks[index] if part == "hair_mask" else None)
    return hair_room(true_segments(hair), views, mesh, hair[:, 0], CONFIG)


def test_hair_lies_behind_segments_and_the_air_around_does_not(hair, room):
    found = behind_segments(room, true_segments(hair), CONFIG)
    nodes = room.grid.nodes()
    index, _ = room.grid.index(hair.reshape(-1, 3))
    assert found.reshape(-1)[index].float().mean() > 0.98
    # The hair is at most 13 mm thick; joined voxels and the margin add some millimetres.
    outside = nodes.norm(dim=-1) - RADIUS > 0.027
    assert outside.any()
    assert not found[outside].any()


def test_hair_is_in_its_room(hair, room):
    index, inside = room.grid.index(hair.reshape(-1, 3))
    assert room.masked
    assert inside.all()
    assert room.domain.reshape(-1)[index].float().mean() > 0.97


def test_an_inset_room_keeps_off_the_surface_but_not_off_the_head(room):
    depth = 2 * room.grid.spacing
    found = room.inset(depth)
    nodes = room.grid.nodes()
    height = nodes.norm(dim=-1) - RADIUS
    # Some nodes, each compared with every empty one outside the ball.
    some = torch.nonzero(room.domain & (height > depth + 0.002))
    some = some[torch.randperm(len(some), generator=torch.Generator().manual_seed(0))[:300]]
    air = torch.nonzero(~room.domain & (height > 0.004))
    steps = (some[:, None] - air[None]).abs().amax(dim=-1).amin(dim=1)
    kept = found.domain[tuple(some.T)]
    assert not kept[steps <= 2].any()
    assert kept[steps > 3].all()
    assert torch.equal(found.domain[height < depth - 0.003], room.domain[height < depth - 0.003])


def test_hanging_hair_runs_as_combed_hair_does(hair, room):
    normals = torch.nn.functional.normalize(hair[:, 0], dim=-1)
    flow = hanging_flow(room, true_segments(hair), hair[:, 0], normals, CONFIG)
    found = flow.grid.sample(flow.directions, hair[:, 4:-1].reshape(-1, 3), outside="border")
    along = torch.nn.functional.normalize(segments(hair[:, 4:]).reshape(-1, 3), dim=-1)
    cosine = torch.nn.functional.cosine_similarity(found, along)
    assert cosine.median() > math.cos(math.radians(20))
    assert (cosine > 0).float().mean() > 0.97


def test_directions_at_the_scalp_do_not_lead_into_it(hair, room, generator):
    given = torch.nn.functional.normalize(torch.randn(*room.grid.shape, 3, generator=generator), dim=-1)
    found = along_scalp(FlowField(room.grid, given, room.domain), room.layer, hair[:, 0]).directions
    nodes = room.grid.nodes()
    height, outward = nodes.norm(dim=-1) - RADIUS, torch.nn.functional.normalize(nodes, dim=-1)
    into, rise = (given * outward).sum(dim=-1), (found * outward).sum(dim=-1)
    from_roots = torch.cdist(nodes.reshape(-1, 3), hair[:, 0]).amin(dim=1).view(room.grid.shape)
    # The ball is a mesh, its distances are interpolated on a coarse grid, and directions straight into it leave next
    # to nothing that lies along it.
    skin = room.domain & (height < 0) & (from_roots < SKIN - 0.003) & (into > -0.8)
    assert skin.any()
    assert float(rise[skin].min()) > -0.1
    for same in (height > SKIN + 0.001, ~room.domain, from_roots > 2.5 * SKIN, into > 0.1):
        torch.testing.assert_close(found[same], given[same])
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(room.grid.shape))
