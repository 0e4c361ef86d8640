"""The room of the hair and the flow of hanging hair, on a ball."""

import math

import pytest
import torch
from tiny_capture import RADIUS, ball, cameras, combed_strands, true_segments

from neural_strands.flow.field import FlowConfig
from neural_strands.flow.hair_flow import (
    HairRoom,
    InitialConfig,
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
    some = torch.nonzero(room.domain & (height > depth + 0.002)).short()
    some = some[torch.randperm(len(some), generator=torch.Generator().manual_seed(0))[:300]]
    air = torch.nonzero(~room.domain & (height > 0.004)).short()
    steps = torch.cat([(part[:, None] - air).abs().amax(dim=-1).amin(dim=1) for part in some.split(2)])
    kept = found.domain[tuple(some.long().T)]
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
