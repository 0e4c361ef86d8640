"""Quality of views against the metrics themselves, on a model without hair that shows its background."""

import torch

from neural_strands.evaluation.held_out import view_qualities
from neural_strands.evaluation.image_metrics import psnr, ssim
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.renderer import HairRenderer
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.scalp.roots import Roots


def test_each_view_is_judged_in_its_hair_region(generator):
    config = HairModelConfig(ScalpTextureConfig(8, 64, 8), UNetConfig(widths=(8, 8)), points=10)
    roots = Roots(
        torch.zeros(2, 3), torch.rand(2, 2, generator=generator), torch.eye(3).expand(2, 3, 3), torch.zeros(2)
    )
    model = HairModel(config, roots, StrandGenerator(), Mesh(torch.zeros(0, 3), torch.zeros(0, 3).long()), generator)
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 60.0, (40, 40), "front")
    photograph = torch.rand(40, 40, 3, generator=generator)
    mask = torch.zeros(40, 40)
    mask[10:30, 5:25] = 1.0
    with torch.no_grad():
        strands = model.decode()
        rendered = model.render(strands, camera).rgb.clamp(0, 1)
    (quality,) = view_qualities(HairRenderer.of(model), [(camera, photograph, mask)], None)
    assert quality.name == "front"
    assert quality.lpips is None
    torch.testing.assert_close(quality.rendered, rendered)
    torch.testing.assert_close(torch.tensor(quality.psnr), psnr(rendered, photograph, mask))
    torch.testing.assert_close(torch.tensor(quality.ssim), ssim(rendered, photograph, mask))
    outside = photograph.clone()
    outside[mask == 0] = 0.0
    (again,) = view_qualities(HairRenderer.of(model), [(camera, outside, mask)], None)
    assert again.psnr == quality.psnr
