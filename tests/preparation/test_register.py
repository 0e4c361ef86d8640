"""Structure from motion on real photographs, and the message if there is nothing to find."""

from pathlib import Path

import numpy as np
import pytest

from neural_strands.capture.colmap import read_colmap
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.cameras.register import match_photographs, register
from neural_strands.preparation.photographs.folder import Photograph, import_photographs, write_picture

pytest.importorskip("pycolmap")


def folders(tmp_path: Path) -> tuple[Path, Path, Path]:
    made = tmp_path / "photographs", tmp_path / "matches", tmp_path / "model"
    for folder in made:
        folder.mkdir()
    return made


def test_photographs_that_do_not_overlap_are_one_sentence(tmp_path: Path):
    images, matches, model = folders(tmp_path)
    random = np.random.default_rng(0)
    shots = []
    for k in range(4):
        write_picture(images / f"{k}.png", random.integers(0, 256, (96, 128, 3), dtype=np.uint8))
        shots.append(Photograph(f"{k}.png", f"{k}.jpg", 128, 96, 110.0))
    match_photographs(images, shots, matches)
    with pytest.raises(InputError, match="4 photographs: expected them to overlap") as caught:
        register(images, shots, matches, model, lambda _: None)
    assert "\n" not in str(caught.value)


@pytest.mark.slow(seconds=50)
def test_phone_photographs_register(tmp_path: Path, shared_data: Path):
    images, matches, model = folders(tmp_path)
    # Every second photograph, because matching all pairs of all photographs takes four times as long.
    paths = sorted((shared_data / "photos" / "selfie" / "images").glob("*.jpg"))[::2]
    shots = import_photographs(paths, images, 2048, print)
    match_photographs(images, shots, matches)
    points = register(images, shots, matches, model, lambda _: None)
    views = read_colmap(images, model)
    assert len(views) == len(paths) == 25
    assert len(points.position) > 1000
    # All photographs are from one phone: there is one lens, with a plausible focal length.
    assert len({view.lens for view in views}) == 1
    assert 0.5 < views[0].lens.intrinsics[0] / 960 < 2.0
