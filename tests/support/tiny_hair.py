"""A small hair model on a ball, for tests of what comes after a fit."""

import torch
import trimesh

from neural_strands.geometry.frames import orthonormal_frames
from neural_strands.geometry.mesh import Mesh
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.surround.body import SurroundConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.vae import load_prior
from neural_strands.raster.lines import LineConfig
from neural_strands.scalp.roots import Roots

RADIUS = 0.09
"""Radius of the ball, metres; its centre is the origin."""


def tiny_hair_model(strands: int = 200, points: int = 20, seed: int = 0) -> HairModel:
    """Random strands on the upper half of a ball, whose chart is seen from above."""
    random = torch.Generator().manual_seed(seed)
    turn = 2 * torch.pi * torch.rand(strands, generator=random)
    out = torch.rand(strands, generator=random).sqrt() * 0.95
    normal = torch.stack([out * turn.cos(), (1 - out**2).sqrt(), -out * turn.sin()], dim=1)
    frame = orthonormal_frames(normal, torch.tensor([1.0, 0.0, 0.0]).expand(strands, 3))
    uv = 0.5 + 0.5 * torch.stack([normal[:, 0], -normal[:, 2]], dim=1)
    ball = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    body = Mesh(torch.tensor(ball.vertices).float(), torch.tensor(ball.faces).long())
    config = HairModelConfig(
        ScalpTextureConfig(shape_size=16, appearance_size=8, appearance_channels=4),
        UNetConfig(widths=(4, 4)),
        SurroundConfig(background_texture=4, background_directions=6),
        lines=LineConfig(width=1e-4, tip=0.1),
        points=points,
    )
    roots = Roots(RADIUS * normal, uv, frame, torch.zeros(strands))
    model = HairModel(config, roots, load_prior().without_modulator().generator, body, random)
    with torch.no_grad():
        coarse = torch.randn(1, 64, 4, 4, generator=random)
        smooth = torch.nn.functional.interpolate(coarse, size=16, mode="bicubic", align_corners=True)
        model.textures.shape.copy_(0.7 * smooth[0].permute(1, 2, 0))
    return model.eval()
