"""Growth direction: shuffled hair of known direction is turned root first."""

import torch
import trimesh
from parted_hair import parted_strands, patches
from tiny_capture import RADIUS

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.lmvs.growth import GrowthConfig, flip_segments, orient_segments


def sphere(radius: float = 0.1) -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return Mesh(torch.tensor(ball.vertices).float(), torch.tensor(ball.faces).long())


def fountain(generator: torch.Generator, strands: int = 300) -> tuple[LineSegments, torch.Tensor]:
    """Hair that leaves the top of a ball, rises, and falls about it, cut into pieces of ten points, some reversed.

    Most of it hangs, but what rises contradicts gravity: only neighbours and the head can tell.
    """
    around = torch.rand(strands, generator=generator) * 6.2832
    t = torch.linspace(0, 1, 40)
    out = 0.03 + 0.10 * t
    height = 0.096 + 0.16 * t - 0.34 * t**2
    points = torch.stack(
        [out * torch.cos(around[:, None]), height.expand(strands, -1), out * torch.sin(around[:, None])], dim=-1
    )
    direction = torch.nn.functional.normalize(points[:, 1:] - points[:, :-1], dim=-1)
    direction = torch.cat([direction, direction[:, -1:]], dim=1)
    ids = torch.arange(strands * 4).repeat_interleave(10)
    segments = LineSegments(points.reshape(-1, 3), direction.reshape(-1, 3), torch.ones(len(ids)), ids)
    flip = torch.rand(strands * 4, generator=generator) < 0.5
    return flip_segments(segments, flip), flip


def test_segments_run_from_root_to_tip_again(generator: torch.Generator):
    segments, flipped = fountain(generator)
    found = orient_segments(segments, sphere(), None, [], GrowthConfig())
    truth = flip_segments(segments, flipped)
    assert ((found.directions * truth.directions).sum(-1) > 0).float().mean() > 0.99
    assert torch.allclose(found.points, truth.points)


def test_what_falls_tells_what_rises_even_without_a_head(generator: torch.Generator):
    segments, flipped = fountain(generator, strands=1000)
    truth = flip_segments(segments, flipped)
    rising = (truth.directions[:, 1] > 0.3).float()
    assert rising.sum() > 1000

    def right(config: GrowthConfig) -> float:
        found = orient_segments(segments, None, None, [], config)
        agree = ((found.directions * truth.directions).sum(-1) > 0).float()
        return float((agree * rising).sum() / rising.sum())

    assert right(GrowthConfig()) > 0.99
    # If gravity outweighs neighbours, rising hair is reversed.
    assert right(GrowthConfig(gravity=0.5)) < 0.5


def test_patches_that_hang_tell_level_ones_across_gaps(generator: torch.Generator):
    # Gaps of a centimetre between patches; those on the top of the head lie level or climb, and sink towards the head.
    truth = patches(parted_strands(1500), apart=0.02, radius=0.005)
    flipped = torch.rand(truth.segment_count, generator=generator) < 0.5
    head = sphere(RADIUS)
    scalp = torch.nonzero(head.corners().mean(dim=1)[:, 1] > 0.02).squeeze(1)
    top = truth.points[:, 1] > 0.9 * RADIUS
    assert 3000 < top.sum() < 0.5 * len(truth)

    def right(config: GrowthConfig) -> float:
        found = orient_segments(flip_segments(truth, flipped), head, scalp, [], config)
        return float(((found.directions * truth.directions).sum(-1) > 0)[top].float().mean())

    assert right(GrowthConfig()) > 0.99
    # Patches that are on their own follow the little they rise or sink.
    assert right(GrowthConfig(far=0.0)) < 0.95


def test_a_stroke_overrides_and_spreads(generator: torch.Generator):
    segments, flipped = fountain(generator)
    truth = flip_segments(segments, flipped)
    # One upward stroke along a single strand reverses the whole connected hair.
    stroke = truth.points[:40].flip(0)
    strong = GrowthConfig(scalp=0.0, gravity=0.0, stroke_reach=2.0)
    found = orient_segments(segments, sphere(), None, [stroke], strong)
    assert ((found.directions * truth.directions).sum(-1) < 0).float().mean() > 0.95


def test_flipping_twice_is_the_identity(generator: torch.Generator):
    segments, _ = fountain(generator, strands=5)
    flip = torch.rand(20, generator=generator) < 0.5
    again = flip_segments(flip_segments(segments, flip), flip)
    assert torch.equal(again.points, segments.points)
    assert torch.equal(again.directions, segments.directions)


def test_nothing_stays_nothing():
    empty = LineSegments(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0), torch.zeros(0, dtype=torch.int64))
    assert len(orient_segments(empty, None, None, [], GrowthConfig())) == 0
