"""The folder of a capture: quantised truth, a claim for one kind of settings, files that read back."""

import json

import numpy as np
import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.synthesis.capture_folder import UNIT, CaptureFolder, differences, quantised, unit_for

SETTINGS = {"style": "wavy", "views": 3, "melanin": {"eumelanin": 0.5}}


def test_quantised_strands_are_what_the_file_holds(generator):
    strands = Strands((torch.rand(20, 100, 3, generator=generator) - 0.5) * 0.6)
    twice = quantised(quantised(strands))
    assert torch.equal(twice.points, quantised(strands).points)
    assert (quantised(strands).points - strands.points).abs().max() <= 0.51 * UNIT


def test_far_strands_take_a_coarser_unit():
    far = torch.tensor([[[0.0, 1.75, 0.0], [0.0, 1.8, 0.1]]])
    unit = unit_for(far)
    assert unit > UNIT
    assert 1.8 / unit <= 32767
    assert (quantised(Strands(far)).points - far).abs().max() <= 0.51 * unit


def test_a_folder_goes_on_only_with_the_same_settings(tmp_path):
    folder = CaptureFolder(tmp_path / "capture")
    folder.begin(SETTINGS)
    folder.begin(SETTINGS)
    with pytest.raises(InputError, match=r"views: 3 there, 5 now.*--overwrite"):
        folder.begin({**SETTINGS, "views": 5})
    (tmp_path / "capture" / "images").mkdir()
    folder.begin({**SETTINGS, "views": 5}, overwrite=True)
    assert not (tmp_path / "capture" / "images").exists()
    assert json.loads((tmp_path / "capture" / "synthesis.json").read_text())["views"] == 5


def test_a_folder_of_something_else_is_never_touched(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="something else"):
        CaptureFolder(tmp_path).begin(SETTINGS, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


def test_differences_name_what_changed_appeared_or_went():
    assert differences({"a": 1, "b": 2}, {"a": 1, "b": 3, "c": 4}) == ["b: 2 there, 3 now", "c: None there, 4 now"]
    assert differences({"a": [1]}, {"a": [1]}) == []
    assert differences({"a": 1, "head_digest": "x"}, {"a": 2, "head_digest": "y"}) == ["a: 1 there, 2 now"]
    assert differences({"head_digest": "x"}, {"head_digest": "y"}) == ["head_digest: x there, y now"]


def test_cameras_come_back_from_transforms(tmp_path):
    camera = Camera.look_at(torch.tensor([0.3, 0.2, 1.0]), torch.zeros(3), 333.0, (64, 64), "000")
    CaptureFolder(tmp_path).finish([camera])
    document = json.loads((tmp_path / "transforms.json").read_text())
    back = Camera.from_opengl(
        torch.tensor(document["frames"][0]["transform_matrix"]), camera.intrinsics, (document["w"], document["h"])
    )
    assert torch.allclose(back.world_to_camera, camera.world_to_camera, atol=1e-6)
    assert np.isclose(document["fl_x"], 333.0)
