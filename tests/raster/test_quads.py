import pytest
import torch

from neural_strands.raster.quads import QUAD, room_for_quads, whole_quads


@pytest.mark.parametrize("channels", [1, 4, 7])
def test_channels_are_padded_with_zeros(generator, channels):
    features = torch.randn(5, channels, generator=generator)
    padded = whole_quads(features)
    assert padded.shape[1] % QUAD == 0
    assert padded.shape[1] - channels < QUAD
    assert torch.equal(padded[:, :channels], features)
    assert not padded[:, channels:].any()


def test_what_has_room_is_not_copied():
    room = room_for_quads(5, 7, torch.device("cpu"))
    assert room.shape == (5, 8)
    assert whole_quads(room[:, :7]).data_ptr() == room.data_ptr()
    assert whole_quads(room[1:, :7]).data_ptr() == room[1:].data_ptr()


def test_a_view_that_ends_before_the_last_quad_is_copied():
    """Rows of eight numbers, but the last has only seven."""
    features = torch.arange(39.0).as_strided((5, 7), (8, 1))
    padded = whole_quads(features)
    assert torch.equal(padded[:, :7], features)
    assert not padded[:, 7].any()
