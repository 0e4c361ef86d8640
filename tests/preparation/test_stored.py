"""Cameras of pictures as they are stored, where EXIF says how to turn them."""

import json
from pathlib import Path

import numpy as np
import pytest
from photographed_head import write_scene
from PIL import Image

from neural_strands.capture.lens import Lens
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.cameras.calibration import PosedLens, lens_of
from neural_strands.preparation.cameras.given import read_upright_cameras
from neural_strands.preparation.cameras.stored import cameras_of_upright, stored_points, turned
from neural_strands.preparation.photographs.folder import Photograph, import_photographs, read_picture, write_picture
from neural_strands.preparation.photographs.metadata import ORIENTATION, upright
from neural_strands.preparation.prepare import prepare

LENS = Lens((70.0, 75.0, 33.0, 18.0), (0.05, -0.02, 0.03, -0.02, 0.01), 60, 40)
BACK = {1: 0, 3: 2, 6: 1, 8: -1}
"""Quarter turns, counter-clockwise, that lead from the upright picture to the stored one, by EXIF's orientation."""


def stored(path: Path, pixels: np.ndarray, orientation: int) -> None:
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    Image.fromarray(pixels).save(path, exif=exif)


def pose() -> np.ndarray:
    world_to_camera = np.eye(4)
    world_to_camera[:3, :3] = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]
    world_to_camera[:3, 3] = 0.1, -0.2, 3.0
    return world_to_camera


def image_of(posed: PosedLens, point: np.ndarray) -> np.ndarray:
    local = posed.world_to_camera[:3, :3] @ point + posed.world_to_camera[:3, 3]
    return posed.lens.distort(local[:2] / local[2])


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_a_point_is_where_the_upright_picture_shows_it(tmp_path: Path, orientation: int):
    posed = PosedLens(LENS, pose())
    points = np.array([[-0.7, 0.2, 0.1], [0.5, -0.3, 0.2], [0.1, 0.8, -0.4]])
    for k, point in enumerate(points):
        picture = np.zeros((40, 60, 3), np.uint8)
        column, row = np.floor(image_of(posed, point)).astype(int)
        picture[row, column] = 255
        stored(tmp_path / f"{k}.png", picture, orientation)
    out = tmp_path / "out"
    out.mkdir()
    files = sorted(tmp_path.glob("*.png"))
    shots = import_photographs(files, out, 2048, print)
    found = cameras_of_upright({file.name: posed for file in files}, shots, files)
    for shot, point in zip(shots, points, strict=True):
        lens = lens_of(shot, found)
        assert lens is not None
        bright = np.argwhere(read_picture(out / shot.name)[..., 0] == 255)
        assert bright.shape == (1, 2)
        column, row = np.floor(image_of(lens, point)).astype(int)
        assert (row, column) == tuple(bright[0])


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_points_go_back_to_the_stored_picture(orientation: int):
    pixels = np.random.default_rng(0).integers(0, 256, (4, 6, 3), np.uint8)
    whole = np.asarray(upright(Image.fromarray(pixels), orientation))
    rows, columns = np.mgrid[: whole.shape[0], : whole.shape[1]]
    points = np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5
    column, row = np.floor(stored_points(points, (6, 4), orientation)).astype(int).T
    np.testing.assert_array_equal(pixels[row, column], whole.reshape(-1, 3))


def test_points_of_mirrored_pictures_stay():
    points = np.array([[1.5, 2.0], [0.0, 4.0]])
    np.testing.assert_array_equal(stored_points(points, (6, 4), 2), points)


def test_cameras_of_pictures_that_were_turned_before_stay(tmp_path: Path):
    for name, orientation in (("side", 6), ("over", 3), ("plain", 1)):
        stored(tmp_path / f"{name}.png", np.zeros((40, 60, 3), np.uint8), orientation)
    files = sorted(tmp_path.glob("*.png"))
    (tmp_path / "out").mkdir()
    shots = import_photographs(files, tmp_path / "out", 2048, print)
    upright = Lens((75.0, 70.0, 22.0, 33.0), (0.0, 0.0, 0.0, 0.0, 0.0), 40, 60)
    lenses = {file.name: PosedLens(upright if file.stem == "side" else LENS, pose()) for file in files}
    assert cameras_of_upright(lenses, shots, files) == lenses
    # A mirrored picture is no photograph of this world.
    assert turned(lenses["plain.png"], 2) is lenses["plain.png"]


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_a_capture_is_the_same_however_the_phone_was_held(tmp_path: Path, orientation: int):
    scene = write_scene(tmp_path)
    expected = prepare(scene.request(tmp_path / "upright", bend=False), lambda _: None)
    document = json.loads((tmp_path / "transforms.json").read_text())
    angle = {3: np.pi, 6: -np.pi / 2, 8: np.pi / 2}[orientation]
    roll = np.eye(4)
    roll[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    for frame in document["frames"][::2]:
        path = tmp_path / "photos" / Path(frame["file_path"]).name
        stored(path, np.rot90(read_picture(path), BACK[orientation]), orientation)
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ roll).tolist()
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    found = prepare(scene.request(tmp_path / "turned", bend=False), lambda _: None)
    assert found["views_with_face"] == expected["views_with_face"]
    assert found["landmark_error_px"] == pytest.approx(expected["landmark_error_px"], abs=1e-2)
    assert found["metres_per_camera_unit"] == pytest.approx(expected["metres_per_camera_unit"], rel=1e-4)
    first, second = (json.loads((tmp_path / out / "transforms.json").read_text()) for out in ("upright", "turned"))
    for one, other in zip(first["frames"], second["frames"], strict=True):
        np.testing.assert_allclose(one["transform_matrix"], other["transform_matrix"], atol=1e-4)


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_reality_capture_sees_pictures_as_they_are_stored(tmp_path: Path, orientation: int):
    # Its pinhole camera at the origin, pitch 90, looks north (y); 18 mm on 36 mm film are half of the longer side.
    point = np.array([9.5 / 30, 1.0, -6.5 / 30])
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[26, 39] = 255
    files = [tmp_path / f"{name}.png" for name in "abc"]
    for file in files:
        stored(file, picture, orientation)
    columns = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"
    rows = [f"{file.name},0,0,0,0,90,0,18,0,0,0,0,0,0,0,0" for file in files]
    (tmp_path / "cameras.csv").write_text("\n".join([columns, *rows]))
    out = tmp_path / "out"
    out.mkdir()
    shots = import_photographs(files, out, 2048, print)
    found = read_upright_cameras(tmp_path / "cameras.csv", shots, files)
    for shot in shots:
        lens = lens_of(shot, found)
        assert lens is not None
        bright = np.argwhere(read_picture(out / shot.name)[..., 0] == 255)
        column, row = np.floor(image_of(lens, point)).astype(int)
        assert [[row, column]] == bright.tolist()


def test_photographs_of_one_stem_keep_their_own_cameras(tmp_path: Path):
    shots = [Photograph("a.png", "a.jpg", 60, 40), Photograph("a-2.png", "a.png", 60, 40)]
    write_picture(tmp_path / "a.png", np.zeros((40, 60, 3), np.uint8))
    lenses = {"a.jpg": PosedLens(LENS, pose()), "a.png": PosedLens(LENS, np.eye(4))}
    found = cameras_of_upright(lenses, shots, [tmp_path / "a.jpg", tmp_path / "a.png"])
    assert [lens_of(shot, found) for shot in shots] == list(lenses.values())
    with pytest.raises(InputError, match="expected the shape that its camera says"):
        lens_of(Photograph("a.png", "a.jpg", 40, 60), found)


def test_names_that_tell_the_time_are_names_without_a_suffix():
    name = "WhatsApp Image 2026-05-01 at 14.30.22 (1)"
    lens = PosedLens(LENS, pose())
    others = {"WhatsApp Image 2026-05-01 at 14.30.25": PosedLens(LENS, np.eye(4))}
    found = lens_of(Photograph(f"{name}.png", f"{name}.jpeg", 60, 40), {name: lens, **others})
    assert found is not None
    assert found.world_to_camera is lens.world_to_camera
