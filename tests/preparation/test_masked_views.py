"""Pictures and masks on disk become views: as they were written, in [0, 1], and read only when asked for."""

from pathlib import Path

import numpy as np
import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.masks.views import masked_views
from neural_strands.preparation.photographs.folder import write_picture


def test_views_show_what_was_written(tmp_path: Path):
    random = np.random.default_rng(0)
    (tmp_path / "masks").mkdir()
    pictures, masks, cameras = [], [], []
    for name in ("a.png", "b.png"):
        pictures.append(random.integers(0, 256, (12, 16, 3), np.uint8))
        masks.append(random.integers(0, 256, (12, 16), np.uint8))
        write_picture(tmp_path / name, pictures[-1])
        write_picture(tmp_path / "masks" / name, masks[-1])
        cameras.append(Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 20.0, (16, 12), name))
    files = [tmp_path / camera.name for camera in cameras]
    hair = [tmp_path / "masks" / camera.name for camera in cameras]
    views = masked_views(cameras, files, hair, [None, hair[0]])
    for index in (1, 0):
        view = views[index]
        assert view.camera is cameras[index]
        assert (view.person_mask is None) == (index == 0)
        assert view.hair_mask is not None
        np.testing.assert_array_equal((view.image.numpy() * 255).round(), pictures[index])
        np.testing.assert_array_equal((view.hair_mask.numpy() * 255).round(), masks[index])
    person = views.person_mask(1)
    assert person is not None
    np.testing.assert_array_equal((person.numpy() * 255).round(), masks[0])
    files[0].unlink()
    assert views.hair_mask(0) is not None
    with pytest.raises(InputError, match="expected a picture of an earlier stage"):
        views.image(0)
