"""The whole way from pictures to a capture, on the built-in head with a cap of hair, in a frame and unit of its own."""

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from full_disk import smallest_files
from photographed_head import SIDE, UNIT, Scene, write_scene

from neural_strands.capture.capture import Capture
from neural_strands.capture.checks import check_capture
from neural_strands.capture.head import read_head
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.photographs.folder import read_picture, write_picture
from neural_strands.preparation.prepare import prepare
from neural_strands.preparation.request import PrepareRequest, check_out
from neural_strands.preparation.source import find_source


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def prepared(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict, list[str]]:
    out = tmp_path_factory.mktemp("prepared") / "capture"
    said: list[str] = []
    return out, prepare(scene.request(out), said.append), said


@pytest.fixture(scope="module")
def unbent(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., PrepareRequest]:
    """Asks for one capture again, with changes. Its head is not bent and its skull not raised, which saves time."""
    return partial(scene.request, tmp_path_factory.mktemp("unbent") / "capture", bend=False)


def test_the_head_comes_back_to_its_place(scene: Scene, prepared):
    out, figures, _ = prepared
    capture = Capture.load(out)
    head = read_head(capture)
    assert head is not None
    assert figures["metres_per_camera_unit"] == pytest.approx(UNIT, rel=0.06)
    assert 0.02 < figures["scale_error"] < 0.06
    # The world is the template's own frame, except for the estimated scale.
    true = Mesh(scene.head.vertices * figures["metres_per_camera_unit"] / UNIT, scene.head.faces)
    gap = closest_points(head.mesh.vertices, true).distance
    assert float(gap.median()) < 1e-3
    assert figures["landmark_error_px"] < 0.5
    # Its hair is noise, 12 mm above the skin and different in every photograph: it may show little of its height.
    assert 0 <= figures["skull_raised_mm"] < 6
    for camera, given in zip(capture.cameras, scene.cameras, strict=True):
        torch.testing.assert_close(camera.rotation, given.rotation, atol=5e-3, rtol=0)


def test_masks_cover_the_hair(scene: Scene, prepared):
    out, _, _ = prepared
    overlaps, missing = [], []
    for name, true in scene.hair.items():
        found = read_picture(out / "masks" / name)[..., 0] > 127
        overlaps.append((found & true).sum() / (found | true).sum())
        missing.append((true & ~found).sum() / true.sum())
    # Masks are a pixel and a half too wide on purpose, which is a tenth of a mask this small.
    assert np.mean(overlaps) > 0.80
    assert np.mean(missing) < 0.05


def test_the_capture_passes_its_check(prepared):
    out, figures, _ = prepared
    findings = check_capture(out)
    assert [finding for finding in findings if finding.level == "error"] == []
    assert json.loads((out / "preparation.json").read_text()) == figures
    assert 0 < figures["scalp_faces"] <= figures["template_scalp_faces"]


def test_nothing_is_done_twice(scene: Scene, prepared):
    out, figures, _ = prepared
    said: list[str] = []
    before = {path: path.stat().st_mtime_ns for path in (out / "preparation").rglob("*") if path.is_file()}
    assert prepare(scene.request(out), said.append) == figures
    assert said == [
        f"{name}: already done." for name in ("photographs", "cameras", "face", "template", "head", "masks", "skull")
    ]
    assert before == {path: path.stat().st_mtime_ns for path in (out / "preparation").rglob("*") if path.is_file()}


def test_given_masks_and_a_segmenter_are_used(scene: Scene, unbent, tmp_path: Path):
    out = unbent().out
    masks = tmp_path / "masks"
    masks.mkdir()
    for name, true in scene.hair.items():
        write_picture(masks / name, true.astype(np.uint8) * 255)
    said: list[str] = []
    prepare(unbent(masks=masks), said.append)
    assert "masks: already done." not in said
    for name, true in scene.hair.items():
        np.testing.assert_array_equal(read_picture(out / "masks" / name)[..., 0] > 127, true)
    prepare(unbent(segmenter="cp {image} {mask}"), said.append)
    picture = read_picture(out / "masks" / "0.png")
    np.testing.assert_array_equal(picture[..., 0], read_picture(out / "images" / "0.png")[..., 0])
    with pytest.raises(InputError, match=r"expected a mask of 0\.png, found"):
        prepare(unbent(segmenter="false {image} {mask}"), said.append)
    with pytest.raises(InputError, match="does not start"):
        prepare(unbent(segmenter="no-such-program {image} {mask}"), said.append)
    with pytest.raises(InputError, match="expected a command with"):
        prepare(unbent(segmenter="program {image}"), said.append)
    (masks / "3.png").unlink()
    with pytest.raises(InputError, match=r"found none of 3\.png"):
        prepare(unbent(masks=masks), said.append)


def test_a_function_makes_masks(unbent):
    out = unbent().out
    said: list[str] = []
    for threshold in (90, 120):
        bright = partial(cv2.inRange, lowerb=(threshold + 1, 0, 0), upperb=(255, 255, 255))
        prepare(unbent(segmenter=bright), said.append)
        picture = read_picture(out / "images" / "2.png")[..., 0]
        np.testing.assert_array_equal(read_picture(out / "masks" / "2.png")[..., 0] > 0, picture > threshold)
    assert "masks: already done." not in said
    with pytest.raises(InputError, match=r"expected a mask of 200 x 200 8-bit values for 0\.png, found bool"):
        prepare(unbent(segmenter=lambda rgb: rgb[..., 0] > 90), print)


def test_edited_masks_are_taken_up(scene: Scene, prepared, tmp_path: Path):
    out, figures = tmp_path / "capture", prepared[1]
    shutil.copytree(prepared[0], out)
    found = (out / "masks" / "1.png").read_bytes()
    painted = np.zeros((SIDE, SIDE), np.uint8)
    painted[:60] = 255
    # Editors write in place or replace the file; neither may reach the stage's own mask.
    (out / "masks" / "3.png").write_bytes((out / "masks" / "4.png").read_bytes())
    write_picture(out / "masks" / "0.png", painted)
    # Without a detector there are no person masks; one that the user adds is kept.
    (out / "person_masks").mkdir()
    write_picture(out / "person_masks" / "0.png", painted)
    said: list[str] = []
    prepare(scene.request(out), said.append)
    assert Capture.load(out).person_mask(0) is not None
    assert [line for line in said if "edited" in line] == [
        "2 masks that you edited are kept (masks/0.png, masks/3.png); delete one to undo that."
    ]
    assert "masks: already done." in said
    assert "skull: already done." not in said
    np.testing.assert_array_equal(read_picture(out / "masks" / "0.png")[..., 0], painted)
    assert (out / "masks" / "3.png").read_bytes() == (out / "masks" / "4.png").read_bytes()
    assert (out / "masks" / "1.png").read_bytes() == found
    # Edits are kept although the stage is done again, and are used: without hair, only unseen scalp remains.
    for name in scene.hair:
        write_picture(out / "masks" / name, np.zeros((SIDE, SIDE), np.uint8))
    bald = prepare(scene.request(out, segmenter="cp {image} {mask}"), lambda _: None)
    assert bald["scalp_faces"] < 0.5 * figures["scalp_faces"]
    assert bald["skull_raised_mm"] == 0
    assert not read_picture(out / "masks" / "5.png").any()
    for name in scene.hair:
        (out / "masks" / name).unlink()
    assert prepare(scene.request(out), lambda _: None) == figures
    assert (out / "masks" / "1.png").read_bytes() == found


def test_edited_masks_of_other_pictures_are_set_aside(scene: Scene, tmp_path: Path):
    photos, out = tmp_path / "photos", tmp_path / "capture"
    shutil.copytree(scene.folder / "photos", photos)
    prepare(scene.request(out, bend=False, photographs=photos), lambda _: None)
    write_picture(out / "masks" / "2.png", np.zeros((SIDE, SIDE), np.uint8))
    edited = (out / "masks" / "2.png").read_bytes()
    shutil.copyfile(photos / "3.png", photos / "2.png")
    said: list[str] = []
    prepare(scene.request(out, bend=False, photographs=photos), said.append)
    (told,) = [line for line in said if "edited" in line]
    assert "1 that you edited no longer fit their pictures (masks/2.png) and are moved to" in told
    assert (out / "preparation" / "replaced_masks" / "masks" / "2.png").read_bytes() == edited
    assert read_picture(out / "masks" / "2.png").any()


def test_landmarks_are_in_pixels_of_the_photograph_as_it_was_taken(scene: Scene, prepared, tmp_path: Path):
    _, figures, _ = prepared
    large = tmp_path / "photos"
    large.mkdir()
    for photograph in (scene.folder / "photos").iterdir():
        picture = read_picture(photograph)
        write_picture(large / photograph.name, picture.repeat(2, axis=0).repeat(2, axis=1))
    marks = json.loads((scene.folder / "landmarks.json").read_text())
    doubled = {view: {mark: [2 * x, 2 * y] for mark, (x, y) in face.items()} for view, face in marks.items()}
    (tmp_path / "landmarks.json").write_text(json.dumps(doubled))
    request = scene.request(tmp_path / "capture", photographs=large, longest_side=SIDE)
    request = replace(request, head=replace(request.head, landmarks=tmp_path / "landmarks.json"))
    again = prepare(request, lambda _: None)
    assert again["landmark_error_px"] < 0.5
    assert again["metres_per_camera_unit"] == pytest.approx(figures["metres_per_camera_unit"], rel=1e-3)


def masks_like(pictures: str, tmp_path: Path) -> Path:
    """A stand-in for the detector: it finds no face, and masks of the person in files of `pictures` (a Python path)."""
    detector = tmp_path / "python"
    program = (
        "import json, os, pathlib, shutil, sys\n"
        "request = json.load(sys.stdin)\n"
        "for path in map(pathlib.Path, request['images']):\n"
        f"    shutil.copyfile({pictures}, os.path.join(request['masks'], path.name))\n"
        "    print(json.dumps({'image': str(path), 'faces': []}), flush=True)\n"
    )
    detector.write_text(f"#!{sys.executable}\n{program}")
    detector.chmod(0o755)
    return detector


def test_edited_masks_of_the_person_guide_head_and_hair(scene: Scene, tmp_path: Path):
    out, people = tmp_path / "capture", tmp_path / "people"
    people.mkdir()
    for name in scene.hair:
        # Everything but the dark wall is the person.
        person = read_picture(scene.folder / "photos" / name).max(axis=2) > 0
        write_picture(people / name, person.astype(np.uint8) * 255)
    request = scene.request(out)
    detector = Detector(masks_like(f"pathlib.Path({str(people)!r}) / path.name", tmp_path))
    request = replace(request, head=replace(request.head, detector=detector))
    prepare(request, lambda _: None)
    assert (read_picture(out / "masks" / "4.png")[..., 0] > 127).sum() > 0.5 * scene.hair["4.png"].sum()
    said: list[str] = []
    # Painting programs may write colours and an alpha channel.
    nobody = np.zeros((SIDE, SIDE, 4), np.uint8)
    nobody[..., 3] = 255
    cv2.imwrite(str(out / "person_masks" / "4.png"), nobody)
    prepare(request, said.append)
    done = [name for name in ("face", "template", "head", "masks", "skull") if f"{name}: already done." in said]
    assert done == ["face", "template"]
    assert (read_picture(out / "masks" / "4.png")[..., 0] > 127).sum() < 0.05 * scene.hair["4.png"].sum()
    assert not read_picture(out / "person_masks" / "4.png").any()
    # A mask of another shape is told.
    write_picture(out / "person_masks" / "4.png", nobody[: SIDE // 2, :, 0])
    with pytest.raises(InputError, match=r"4\.png: expected the photograph's shape"):
        prepare(request, said.append)


def test_a_detector_finds_the_person_though_landmarks_are_set_by_hand(scene: Scene, prepared, tmp_path: Path):
    out = tmp_path / "capture"
    detector = masks_like("path", tmp_path)
    request = scene.request(out, bend=False)
    figures = prepare(request, lambda _: None)
    assert not (out / "person_masks").exists()
    request = replace(request, head=replace(request.head, detector=Detector(detector)))
    again = prepare(request, lambda _: None)
    assert again["landmark_error_px"] == figures["landmark_error_px"]
    for picture in (out / "images").iterdir():
        assert (out / "person_masks" / picture.name).read_bytes() == picture.read_bytes()
    with pytest.raises(InputError, match="expected a file for the face detector"):
        prepare(replace(request, head=replace(request.head, detector=Detector(tmp_path / "absent"))), print)


def test_a_measured_length_makes_the_scale(unbent):
    from neural_strands.preparation.head.fit import KnownSize

    figures = prepare(unbent(size=KnownSize(metres_per_unit=UNIT)), lambda _: None)
    assert figures["metres_per_camera_unit"] == UNIT
    assert figures["scale_error"] == 0.0
    with pytest.raises(InputError, match="expected both irises"):
        prepare(unbent(size=KnownSize(pupil_distance=0.062)), lambda _: None)


def test_what_is_the_users_is_left_alone(scene: Scene, prepared, tmp_path: Path):
    theirs = tmp_path / "theirs"
    (theirs / "images").mkdir(parents=True)
    (theirs / "images" / "a.png").write_bytes(b"mine")
    with pytest.raises(InputError, match="expected a new or empty folder"):
        prepare(scene.request(theirs), print)
    with pytest.raises(InputError, match="expected a new or empty folder"):
        prepare(scene.request(theirs / "images" / "a.png"), print)
    assert (theirs / "images" / "a.png").read_bytes() == b"mine"
    out, _, _ = prepared
    for changes in ({"photographs": out / "images"}, {"masks": out / "masks"}):
        with pytest.raises(InputError, match="expected a folder outside"):
            prepare(scene.request(out, **changes), print)


@pytest.mark.parametrize("name", [".DS_Store", "desktop.ini", "Thumbs.db"])
def test_a_folder_that_was_only_looked_at_is_empty(scene: Scene, tmp_path: Path, name: str):
    (tmp_path / name).write_bytes(b"the system's")
    request = scene.request(tmp_path)
    source = find_source(request.photographs, request.cameras)
    check_out(request, source)
    (tmp_path / "notes.txt").touch()
    with pytest.raises(InputError, match="expected a new or empty folder"):
        check_out(request, source)


def test_wrong_files_are_told_before_anything_is_computed(scene: Scene, tmp_path: Path):
    marks, flame = tmp_path / "marks.json", tmp_path / "flame.pkl"
    marks.write_text(json.dumps({"0.png": {"nostril": [1, 2]}}))
    flame.write_bytes(b"no pickle")
    request = scene.request(tmp_path / "capture")
    with pytest.raises(InputError, match="expected landmarks out of"):
        prepare(replace(request, head=replace(request.head, landmarks=marks)), print)
    detector = Detector(Path(sys.executable))
    with pytest.raises(InputError, match="expected FLAME's model"):
        prepare(replace(request, head=replace(request.head, template=flame, detector=detector)), print)
    assert not (tmp_path / "capture").exists()


def test_a_full_disk_keeps_the_stages_that_are_done(scene: Scene, tmp_path: Path):
    out = tmp_path / "capture"
    with smallest_files(200_000), pytest.raises(InputError, match="cannot be written"):
        prepare(scene.request(out, bend=False), lambda _: None)
    assert not (out / "transforms.json").exists()
    done = {path.name for path in (out / "preparation").iterdir() if not path.name.startswith(".")}
    assert {"photographs", "cameras", "face"} <= done
    said: list[str] = []
    prepare(scene.request(out, bend=False), said.append)
    assert "face: already done." in said
