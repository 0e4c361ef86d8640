"""Pictures are written whole."""

from pathlib import Path

import cv2
import torch

from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.pictures import Panel, draw_panels


def test_a_grid_is_drawn_with_a_row_a_label(tmp_path: Path) -> None:
    strands = synthetic_curves(3, torch.Generator().manual_seed(0))
    path = tmp_path / "deep" / "picture.png"
    rows = [[Panel((strands[0], strands[1]), "two"), Panel((strands[2],))], [Panel((strands[2],))]]
    draw_panels(path, rows, ("first", "second"), "legend")
    image = cv2.imread(str(path))
    assert image is not None
    height, width = image.shape[:2]
    assert height > 300
    assert width > 300
    # The second row has no second panel: that corner is blank.
    assert (image[height * 3 // 4 :, width * 3 // 4 :] == 255).all()
    assert (image < 128).any()
