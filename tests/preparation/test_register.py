"""Structure from motion on real photographs, and the message if there is nothing to find."""

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from full_disk import smallest_files
from papered_room import photographed_room

from neural_strands.capture.colmap import read_colmap
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.cameras import register as register_module
from neural_strands.preparation.cameras.register import DATABASE, match_photographs, register
from neural_strands.preparation.photographs.folder import Photograph, import_photographs, write_picture

if TYPE_CHECKING:
    import pycolmap

pytest.importorskip("pycolmap")


def folders(tmp_path: Path) -> tuple[Path, Path, Path]:
    made = tmp_path / "photographs", tmp_path / "matches", tmp_path / "model"
    for folder in made:
        folder.mkdir()
    return made


def test_outside_the_masks_of_a_person_who_turns_are_no_features(tmp_path: Path):
    import pycolmap

    images, matches, masks = folders(tmp_path)
    random = np.random.default_rng(0)
    shots = []
    for k in range(3):
        cells = random.integers(0, 256, (24, 32, 3), dtype=np.uint8)
        write_picture(images / f"{k}.png", cv2.resize(cells, (256, 192), interpolation=cv2.INTER_CUBIC))
        mask = np.zeros((192, 256), np.uint8)
        mask[:, 128:] = 255
        write_picture(masks / f"{k}.png.png", mask)
        shots.append(Photograph(f"{k}.png", f"{k}.jpg", 256, 192, 220.0))
    match_photographs(images, shots, matches, masks)
    with pycolmap.Database.open(matches / DATABASE) as database:
        places = [database.read_keypoints(image.image_id)[:, 0] for image in database.read_all_images()]
    assert len(places) == 3
    assert all(len(across) > 10 for across in places)
    assert min(across.min() for across in places) > 126


def checked(steps: Iterable[str], title: str, total: int) -> Iterator[str]:
    """Steps of which there must be as many as announced."""
    taken = list(steps)
    assert len(taken) == total, title
    yield from taken


@pytest.mark.slow
@pytest.mark.parametrize("most", [register_module.MATCH_ALL, 4])
def test_matches_and_cameras_are_the_same_however_threads_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int
):
    import pycolmap

    mapping = pycolmap.incremental_mapping

    def with_threads_for_small_models(database, images, out, options, **callbacks):
        options.ba_min_num_residuals_for_cpu_multi_threading = 0
        return mapping(database, images, out, options, **callbacks)

    monkeypatch.setattr(pycolmap, "incremental_mapping", with_threads_for_small_models)
    monkeypatch.setattr(register_module.os, "cpu_count", lambda: 4)
    monkeypatch.setattr(register_module, "MATCH_ALL", most)
    monkeypatch.setattr(register_module, "PARTNERS", 2)
    monkeypatch.setattr(register_module, "track", checked)
    images, shots = photographed_room(tmp_path)
    found = []
    for again in range(2):
        matches, model = tmp_path / f"matches_{again}", tmp_path / f"model_{again}"
        matches.mkdir()
        model.mkdir()
        match_photographs(images, shots, matches)
        points = register(images, shots, matches, model, lambda _: None)
        assert len(points.position) > 100
        with closing(sqlite3.connect(matches / DATABASE)) as database:
            names = database.execute("SELECT name FROM images ORDER BY image_id").fetchall()
            tables = ("keypoints", "descriptors", "matches", "two_view_geometries")
            rows = {table: database.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall() for table in tables}
        assert [name for (name,) in names] == [shot.name for shot in shots]
        found.append((rows, {path.name: path.read_bytes() for path in model.iterdir()}))
    pairs = len(found[0][0]["two_view_geometries"])
    assert 7 <= pairs <= (28 if most > 8 else 16), "all pairs, or two for each photograph and a tree"
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("size", "cores", "threads"),
    [((512, 512), 8, 8), ((2048, 1365), 16, 3), ((6000, 4000), 16, 1), ((2048, 1365), 2, 2)],
)
def test_detectors_at_work_at_once_fit_into_memory(size, cores, threads, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(register_module.os, "cpu_count", lambda: cores)
    assert register_module._detector_threads([Photograph("a.png", "a.jpg", size[0], size[1])] * 3) == threads


def test_photographs_that_do_not_overlap_are_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
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
    assert "error" not in capfd.readouterr().err.lower()
    whole = (matches / DATABASE).read_bytes()
    damages = (b"", whole[:5000], b"x" * 9000, whole[: len(whole) // 2], whole[:4096] + bytes(4096) + whole[8192:])
    for damaged in damages:
        (matches / DATABASE).write_bytes(damaged)
        with pytest.raises(InputError, match="COLMAP's database of 4 photographs, found a damaged one; remove its"):
            register(images, shots, matches, model, lambda _: None)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("most", [20_000, 200_000])
def test_a_full_disk_is_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str], most: int):
    images, matches, _ = folders(tmp_path)
    random = np.random.default_rng(0)
    shots = []
    for k in range(3):
        cells = random.integers(0, 256, (96, 128, 3), dtype=np.uint8)
        write_picture(images / f"{k}.png", cv2.resize(cells, (512, 384), interpolation=cv2.INTER_CUBIC))
        shots.append(Photograph(f"{k}.png", f"{k}.jpg", 512, 384, 440.0))
    sentence = "expected COLMAP to finish, found: .*; see that the disk has room"
    with smallest_files(most), pytest.raises(InputError, match=sentence) as caught:
        match_photographs(images, shots, matches)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def photographed(lenses: int, params: list[float]) -> "pycolmap.Reconstruction":
    """A model of 20 photographs by each lens."""
    import pycolmap

    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = lenses, 1, 20
    options.camera_params = params
    pycolmap.set_random_seed(0)
    return pycolmap.synthesize_dataset(options)


def test_principal_points_are_found_of_lenses_that_enough_photographs_share():
    import pycolmap

    true, middle = [1280.0, 560.0, 350.0, 0.05], [1280.0, 512.0, 384.0, 0.05]
    model = photographed(2, true)
    common, rare = model.cameras.values()
    for image in [image for image in model.images.values() if image.camera_id == rare.camera_id][2:]:
        model.deregister_frame(image.frame_id)
    common.params, rare.params = middle, middle
    said: list[str] = []
    found = register_module._with_free_centres(pycolmap, model, said.append)
    assert said == []
    # Photographs that are free of error yield the lens, except for the two that know no better.
    np.testing.assert_allclose(found.cameras[common.camera_id].params[:3], true[:3], atol=15)
    np.testing.assert_array_equal(found.cameras[rare.camera_id].params, middle)


def test_principal_points_stay_in_the_middle_where_photographs_do_not_tell_them():
    import pycolmap

    middle = [1280.0, 512.0, 384.0, 0.05]
    model = photographed(1, middle)
    noise = pycolmap.SyntheticNoiseOptions()
    noise.point2D_stddev = 0.5
    pycolmap.synthesize_noise(noise, model)
    (lens,) = model.cameras.values()
    places = {image.name: image.projection_center() for image in model.images.values()}
    said: list[str] = []
    # What is left of the error is noise, which no lens explains: nothing moves.
    assert register_module._with_free_centres(pycolmap, model, said.append) is model
    assert said == []
    np.testing.assert_array_equal(lens.params, middle)
    for image in model.images.values():
        np.testing.assert_array_equal(image.projection_center(), places[image.name])


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
