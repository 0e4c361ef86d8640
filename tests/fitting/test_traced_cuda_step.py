"""The losses of an image step, traced on a fake CUDA device: devices, shapes, synchronisations."""

import torch
from tiny_capture import tiny_config
from tiny_hair import tiny_hair_model
from traced_cuda import on_traced_cuda, traced_cuda

from neural_strands.fitting.losses import alpha_loss, rendering_loss
from neural_strands.fitting.photographs.surround_weights import surround_weights
from neural_strands.fitting.photographs.trimap import reference_alpha
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.views import View

WIDTH, HEIGHT = 64, 48


def test_the_losses_of_an_image_step_stay_on_the_device():
    model, config = tiny_hair_model(), tiny_config()
    with traced_cuda() as (mode, waits):
        on_traced_cuda(model, mode)
        camera = Camera.look_at(torch.tensor([0.0, 0.1, 0.6]), torch.zeros(3), 100.0, (WIDTH, HEIGHT))
        mask = torch.rand(HEIGHT, WIDTH, device="cuda")
        view = View(camera, torch.rand(HEIGHT, WIDTH, 3, device="cuda"), mask)
        strands = model.decode()
        waits.clear()
        trimap = reference_alpha(mask, Rectangle(0, 0, WIDTH, HEIGHT), config.trimap)
        output = model.render(strands, camera, gradient_weights=surround_weights(view))
        for loss in (rendering_loss(output.rgb, view.image), alpha_loss(output.alpha, trimap.alpha, trimap.supervised)):
            assert loss.device.type == "cuda"
            assert loss.shape == ()
        # The box of the hair (six numbers of one answer), the visible parts, and once a model the background's centre.
        assert dict(waits) == {"aten._local_scalar_dense.default": 7, "to the CPU": 1}
