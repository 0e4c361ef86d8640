"""Images as bytes: what is decoded is what was encoded."""

import cv2
import numpy as np
import pytest
import torch
from full_disk import smallest_files

from neural_strands.foundation.errors import InputError
from neural_strands.pictures.encoding import encode_png, encode_webp, to_bytes, write_png


def decoded(data: bytes) -> np.ndarray:
    samples = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert samples is not None
    if samples.ndim == 2:
        return samples
    return samples[..., [2, 1, 0] if samples.shape[2] == 3 else [2, 1, 0, 3]]


def test_values_go_to_the_nearest_of_256_levels_and_are_clamped(generator):
    image = torch.rand(5, 7, 3, generator=generator) * 1.2 - 0.1
    expected = (image.clamp(0, 1) * 255).round().byte().numpy()
    np.testing.assert_array_equal(to_bytes(image), expected)
    np.testing.assert_array_equal(decoded(encode_png(image)), expected)


@pytest.mark.parametrize("channels", [(), (3,), (4,)])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_samples_come_back_bit_for_bit(channels, kind):
    samples = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (6, 9, *channels), dtype=kind, endpoint=True)
    np.testing.assert_array_equal(decoded(encode_png(samples)), samples)


def test_one_channel_is_grey(generator):
    mask = torch.rand(4, 5, 1, generator=generator)
    np.testing.assert_array_equal(decoded(encode_png(mask)), to_bytes(mask[..., 0]))


def test_webp_keeps_flat_colours():
    image = torch.full((16, 16, 3), 0.5)
    image[..., 0] = 0.25
    assert np.abs(decoded(encode_webp(image)).astype(int) - to_bytes(image)).max() <= 3


def test_an_image_without_pixels_is_refused():
    with pytest.raises(ValueError, match=r"expected an image with pixels, found one of shape \(0, 3, 3\)"):
        encode_png(torch.zeros(0, 3, 3))


def test_other_suffixes_are_refused_and_a_full_disk_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match=r"picture\.jpg: expected a name that ends in \.png, found '\.jpg'"):
        write_png(tmp_path / "picture.jpg", torch.zeros(2, 2, 3))
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    with smallest_files(100), pytest.raises(InputError, match="cannot be written"):
        write_png(tmp_path / "picture.png", noise)
    assert not list(tmp_path.iterdir())
