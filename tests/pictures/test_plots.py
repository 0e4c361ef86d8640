"""Plots: the grid of panels, curves and the scalp chart."""

import torch

from neural_strands.pictures.plots import Panel, chart_plot, curves_plot, panels_plot
from neural_strands.prior.curves import synthetic_curves


def test_a_grid_has_a_row_for_each_label(generator):
    strands = synthetic_curves(3, generator)
    rows = [[Panel((strands[0], strands[1]), "two"), Panel((strands[2],))], [Panel((strands[2],))]]
    image = panels_plot(rows, ("first", "second"), "legend")
    height, width, _ = image.shape
    assert height > 300
    assert width > 300
    # The second row has no second panel: that corner is blank.
    assert (image[height * 3 // 4 :, width * 3 // 4 :] == 1).all()
    assert (image < 0.5).any()


def test_curves_leave_out_what_a_logarithm_cannot_show():
    image = curves_plot({"a": [(1.0, 0.5), (2.0, 0.25)], "b": [], "c": [(1.0, 0.0)]}, "losses")
    assert image.shape[2] == 3
    assert float(image.std()) > 0.01


def test_roots_lie_where_the_chart_says():
    faces = torch.tensor([[[0.1, 0.1], [0.9, 0.1], [0.1, 0.9]]])
    plain = chart_plot(faces, torch.zeros(0, 2))
    changed = (chart_plot(faces, torch.tensor([[0.25, 0.75]])) - plain).abs().amax(dim=-1) > 0.1
    row, column = changed.nonzero().float().mean(dim=0).tolist()
    side = len(plain)
    # The axes span 0.09 to 0.99 across and 0.07 to 0.97 up.
    assert abs(column / side - (0.09 + 0.9 * 0.25)) < 0.005
    assert abs(1 - row / side - (0.07 + 0.9 * 0.75)) < 0.005
