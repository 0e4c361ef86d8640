"""The capture for timing is complete, and its pictures show its strands."""

import torch

from neural_strands.capture.capture import Capture
from neural_strands.raster.dilation import dilate
from neural_strands.raster.lines import rasterise_lines


def test_masks_show_the_strands_in_front_of_the_head(benchmark_module, tmp_path):
    drawn = benchmark_module("speed", "drawn_capture")
    drawn.main(drawn.Arguments(tmp_path / "drawn", views=3, resolution=48, strands=150, device="cpu"))
    capture = Capture.load(tmp_path / "drawn")
    assert len(capture) == 3
    assert capture.ground_truth is not None
    assert len(capture.ground_truth.points) == 150
    for view in capture.views_on(torch.device("cpu")):
        assert view.hair_mask is not None
        # Where no strand comes near, there is none in the mask.
        lines = dilate(rasterise_lines(capture.ground_truth.points, view.camera).segment >= 0, 2)
        assert 0.01 < view.hair_mask.mean() < 0.6
        assert (view.hair_mask[~lines] == 0).all()
        assert view.image.std() > 0.02
