"""Sums over the voxels behind faces, against plain torch and counts by hand."""

import torch

from neural_strands.flow.faces import (
    face_neighbours,
    neighbour_mean,
    neighbour_mean_reference,
    neighbour_sum,
    neighbour_sum_reference,
)


def test_sums_and_means_agree_with_their_twins(device, generator):
    domain = (torch.rand(14, 15, 16, generator=generator) > 0.5).to(device)
    neighbours = face_neighbours(domain)
    for channels in (1, 2, 3):
        values = torch.randn(len(neighbours), channels, generator=generator).to(device)
        for ours, twin in ((neighbour_sum, neighbour_sum_reference), (neighbour_mean, neighbour_mean_reference)):
            torch.testing.assert_close(
                ours(values, neighbours), twin(values, neighbours), atol=1e-6, rtol=1e-6, msg=ours.__name__
            )


def test_the_mean_counts_only_cells_of_the_domain():
    domain = torch.zeros(4, 4, 4, dtype=torch.bool)
    # A row of three cells, and one on its own.
    domain[1, 1, 0:3] = domain[3, 3, 3] = True
    neighbours = face_neighbours(domain)
    values = torch.tensor([[1.0], [10.0], [100.0], [7.0]])
    assert neighbour_mean(values, neighbours)[:, 0].tolist() == [10.0, 50.5, 10.0, 7.0]
