import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from neural_strands.capture import capture as capture_module
from neural_strands.capture.capture import Capture
from neural_strands.capture.head import read_head
from neural_strands.capture.images import read_pixels
from neural_strands.foundation.errors import InputError

POSE = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 1.0], [0, 0, 0, 1.0]]


def write_capture(folder: Path, frames: list[dict], images: dict[str, np.ndarray], **shared) -> Path:
    (folder / "images").mkdir(parents=True)
    for name, pixels in images.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(folder / name), pixels)
    document = {"fl_x": 50.0, "cx": 8.0, "cy": 6.0, "w": 16, "h": 12, **shared, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder


def frame(name: str, **keys) -> dict:
    return {"file_path": name, "transform_matrix": POSE, **keys}


def test_images_of_8_and_16_bits_with_and_without_alpha(tmp_path):
    rgba = np.zeros((12, 16, 4), np.uint16)
    rgba[..., 2], rgba[..., 3] = 65535, 65535 // 2  # red (OpenCV writes BGR), half transparent
    images = {
        "images/a.png": np.full((12, 16, 3), (0, 51, 255), np.uint8),
        "images/b.png": np.full((12, 16), 32768, np.uint16),
        "images/c.png": rgba,
    }
    capture = Capture.load(write_capture(tmp_path / "c", [frame(name) for name in images], images))
    torch.testing.assert_close(capture.image(0)[3, 4], torch.tensor([1.0, 0.2, 0.0]))
    torch.testing.assert_close(capture.image(1)[3, 4], torch.full((3,), 32768 / 65535))
    half_the_light = 1.055 * 0.5 ** (1 / 2.4) - 0.055
    torch.testing.assert_close(capture.image(2)[3, 4], torch.tensor([half_the_light, 0.0, 0.0]), atol=1e-4, rtol=0)
    assert capture.person_mask(0) is None
    torch.testing.assert_close(capture.person_mask(2), torch.full((12, 16), 0.5), atol=1e-4, rtol=0)
    assert capture.hair_mask(0) is None


def test_masks_are_found_by_key_and_by_name(tmp_path):
    grey = np.full((12, 16), 128, np.uint8)
    images = {
        "images/a.jpg": grey,
        "images/b.jpg": grey,
        "hair.png": grey,
        "masks/b.png": grey,
        "person_masks/a.jpg.png": grey,
    }
    frames = [frame("images/a.jpg", mask_path="hair.png"), frame("images/b.jpg")]
    capture = Capture.load(write_capture(tmp_path / "c", frames, images))
    for mask in (capture.hair_mask(0), capture.hair_mask(1), capture.person_mask(0)):
        torch.testing.assert_close(mask, torch.full((12, 16), 128 / 255))


def test_per_frame_intrinsics_and_sizes_win(tmp_path):
    images = {"images/a.png": np.zeros((12, 16, 3), np.uint8), "images/b.png": np.zeros((30, 20, 3), np.uint8)}
    frames = [frame("images/a.png"), frame("images/b.png", w=20, h=30, fl_x=70.0, fl_y=71.0, cx=9.0, cy=14.0)]
    capture = Capture.load(write_capture(tmp_path / "c", frames, images))
    assert capture.image(1).shape == (30, 20, 3)
    assert capture.cameras[1].intrinsics.tolist() == [[70.0, 0.0, 9.0], [0.0, 71.0, 14.0], [0.0, 0.0, 1.0]]
    assert capture.cameras[0].intrinsics[1, 1] == 50.0
    # OpenGL camera at z = 1 looking down -z: the world origin is one metre ahead, on the principal point.
    pixel, depth = capture.cameras[1].project(torch.zeros(3))
    assert depth == 1.0
    assert pixel.tolist() == [9.0, 14.0]
    assert capture.subset([1]).cameras[0].name == "b.png"


def test_the_cache_keeps_to_its_budget(tmp_path):
    images = {f"images/{k}.png": np.full((12, 16, 3), k, np.uint8) for k in range(5)}
    folder = write_capture(tmp_path / "c", [frame(name) for name in images], images)
    capture = Capture.load(folder, cache_bytes=2 * 12 * 16 * 3)
    for k in range(5):
        assert capture.image(k)[0, 0, 0] == pytest.approx(k / 255)
        assert capture.cache.used <= capture.cache.budget
    (folder / "images/4.png").unlink()
    assert capture.image(4)[0, 0, 0] == pytest.approx(4 / 255)
    (folder / "images/0.png").unlink()
    with pytest.raises(InputError, match=r"0\.png"):
        capture.image(0)


def test_views_are_read_when_asked_for_and_each_file_is_decoded_once(tmp_path, monkeypatch):
    rgba = np.full((12, 16, 4), 128, np.uint8)
    grey = np.full((12, 16), 51, np.uint8)
    images = {"images/a.png": rgba, "images/b.png": rgba[..., :3], "masks/a.png": grey, "person_masks/b.png": grey}
    frames = [frame("images/a.png"), frame("images/b.png")]
    decoded = []

    def counted(path, size):
        decoded.append(path.relative_to(tmp_path / "c").as_posix())
        return read_pixels(path, size)

    monkeypatch.setattr(capture_module, "read_pixels", counted)
    capture = Capture.load(write_capture(tmp_path / "c", frames, images))
    views = capture.views_on("cpu")
    for seen, given in zip(views.cameras, capture.cameras, strict=True):
        assert (seen.name, seen.width, seen.height) == (given.name, given.width, given.height)
        assert torch.equal(seen.world_to_camera, given.world_to_camera)
        assert torch.equal(seen.intrinsics, given.intrinsics)
    assert views.has_hair_mask == (True, False)
    assert decoded == []
    assert [float(mask[0, 0]) for _, mask in views.hair_masks()] == [pytest.approx(0.2)]
    assert decoded == ["masks/a.png"]
    first, second = views
    # The first view's person mask is its photograph's alpha.
    assert sorted(decoded) == sorted(images)
    assert torch.equal(first.image, capture.image(0))
    assert float(first.person_mask[0, 0]) == pytest.approx(128 / 255)
    assert float(second.person_mask[0, 0]) == pytest.approx(0.2)
    assert second.hair_mask is None
    assert len(decoded) == len(images)


def test_an_image_too_large_to_keep_is_not_searched_for_alpha_again(tmp_path, monkeypatch):
    images = {"images/a.png": np.zeros((12, 16, 3), np.uint8)}
    capture = Capture.load(write_capture(tmp_path / "c", [frame("images/a.png")], images), cache_bytes=10)
    capture.image(0)
    monkeypatch.setattr(capture_module, "read_pixels", None)
    assert capture.person_mask(0) is None


def test_photographs_in_sub_folders_have_their_own_names_and_masks(tmp_path):
    images = {f"images/{side}/1.jpg": np.full((12, 16, 3), 90, np.uint8) for side in ("left", "right")}
    images |= {"masks/left/1.png": np.full((12, 16), 51, np.uint8)}
    images |= {"masks/right/1.jpg.png": np.full((12, 16), 102, np.uint8)}
    capture = Capture.load(
        write_capture(tmp_path / "c", [frame(f"images/{s}/1.jpg") for s in ("left", "right")], images)
    )
    assert [camera.name for camera in capture.cameras] == ["left/1.jpg", "right/1.jpg"]
    assert [float(capture.hair_mask(k)[0, 0]) for k in (0, 1)] == [pytest.approx(0.2), pytest.approx(0.4)]


def test_real_captures_project_the_truth_into_the_masks(shared_data):
    for name, views, strands in (("sintel_bob", 40, 11_400), ("straight_long", 32, 10_000)):
        capture = Capture.load(shared_data / "captures" / name)
        assert len(capture) == views
        assert capture.ground_truth.points.shape == (strands, 100, 3)
        head = read_head(capture)
        assert int(head.scalp_faces.max()) < len(head.mesh.faces)
        for index in (0, views // 2):
            pixels, depth = capture.cameras[index].project(capture.ground_truth.points.reshape(-1, 3))
            inside = (pixels > 0).all(-1) & (pixels < 512).all(-1) & (depth > 0)
            column, row = pixels[inside].long().unbind(-1)
            hit = torch.zeros(512, 512, dtype=torch.bool)
            hit[row, column] = True
            mask = capture.hair_mask(index) > 0.1
            # Hair behind the head is drawn too, so only this direction can be checked: every hair pixel has a strand.
            assert (hit & mask).sum() / mask.sum() > 0.9
            # A wrong convention of half a pixel shows at the silhouette; from above (view 0), nothing hides hair.
            if index == 0:
                assert (hit & mask).sum() / hit.sum() > 0.93


def test_real_photographs(shared_data):
    capture = Capture.load(shared_data / "photos" / "face")
    assert len(capture) == 65
    assert capture.image(0).shape == (512, 512, 3)
    assert read_head(capture) is None
    assert capture.ground_truth is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frames": []}, "frames"),
        ({"fl_x": None}, "fl_x"),
        ({"fl_x": "wide"}, "fl_x"),
        ({"w": -3}, "w: expected a whole number from 1"),
        ({"camera_model": "OPENCV_FISHEYE"}, "camera_model"),
        ({"frames": [{"file_path": "images/a.png"}]}, "transform_matrix"),
        ({"frames": [{"file_path": "images/a.png", "transform_matrix": [[1, 2], [3, 4]]}]}, "transform_matrix"),
        ({"frames": [{"file_path": "images/a.png", "transform_matrix": (2 * np.eye(4)).tolist()}]}, "rigid"),
        ({"frames": [{"file_path": "images/a.png", "transform_matrix": np.diag([1.0, 1, -1, 1]).tolist()}]}, "rigid"),
        ({"frames": [{}]}, "file_path"),
    ],
)
def test_a_wrong_transforms_file_is_one_sentence(tmp_path, change, message):
    folder = write_capture(tmp_path / "c", [frame("images/a.png")], {"images/a.png": np.zeros((12, 16, 3), np.uint8)})
    document = json.loads((folder / "transforms.json").read_text()) | change
    (folder / "transforms.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=message) as caught:
        Capture.load(folder)
    assert "transforms.json" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_wrong_files_are_one_sentence_each(tmp_path):
    images = {"images/a.png": np.zeros((12, 16, 3), np.uint8), "images/b.png": np.zeros((5, 5, 3), np.uint8)}
    folder = write_capture(tmp_path / "c", [frame(f"images/{n}.png") for n in "abc"], images)
    (folder / "images/c.png").write_text("no image")
    (folder / "head.obj").write_text("v 0 0 0\nf 1 2 3\n")
    np.savez(folder / "ground_truth.npz", strands=np.zeros((3, 4)))
    capture = Capture.load(folder)
    for read, message in (
        (lambda: capture.image(1), "16 x 12"),
        (lambda: capture.image(2), "such as PNG or JPEG"),
        (lambda: read_head(capture), "head.obj"),
        (lambda: capture.ground_truth, "ground_truth.npz"),
    ):
        with pytest.raises(InputError, match=message):
            read()
    with pytest.raises(InputError, match="neither"):
        Capture.load(tmp_path)
    with pytest.raises(InputError, match="nothing"):
        Capture.load(tmp_path / "absent")
