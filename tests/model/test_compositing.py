"""What lies behind and around the hair."""

import torch

from neural_strands.model.compositing import REACH, Background, SurroundConfig, near_hair


def test_the_centre_is_the_present_one_with_and_without_inference_mode():
    for inference in (False, True):
        with torch.inference_mode(inference):
            background = Background(torch.tensor([1.0, 2.0, 3.0]), SurroundConfig())
            assert background.centre_on_cpu.tolist() == [1, 2, 3]
            background.centre[0] = 4.0
            assert background.centre_on_cpu.tolist() == [4, 2, 3]


def test_hair_is_near_its_strands_alone():
    coverage = torch.zeros(90, 70)
    coverage[40, 2:5] = 0.3
    coverage[89, 69] = 0.01
    near = near_hair(coverage)
    rows, columns = torch.meshgrid(torch.arange(90), torch.arange(70), indexing="ij")
    places = torch.stack([rows, columns], dim=-1)
    apart = (places[:, :, None] - torch.nonzero(coverage)).abs().amax(dim=-1).amin(dim=-1)
    assert (near[apart <= REACH] == 1).all()
    assert (near[apart > 3 * REACH] == 0).all()
    between = near[(apart > REACH + 1) & (apart < 3 * REACH)]
    assert ((between > 0) & (between < 1)).all()
