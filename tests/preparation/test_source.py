"""What `prepare` starts from: photographs, a video, or a model with the places of its photographs."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from photographed_head import Scene, write_scene

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.cameras.given import read_cameras
from neural_strands.preparation.photographs.folder import write_picture
from neural_strands.preparation.prepare import prepare
from neural_strands.preparation.request import PrepareRequest
from neural_strands.preparation.source import Source, find_source, has_unused_cameras

NAMES = ("a.png", "b.png", "c.png")


def photographs(folder: Path, names: tuple[str, ...] = NAMES) -> tuple[Path, ...]:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_picture(folder / name, np.zeros((6, 8, 3), np.uint8))
    return tuple(folder / name for name in names)


def colmap(folder: Path, names: tuple[str, ...] = NAMES) -> Path:
    folder.mkdir(parents=True)
    (folder / "cameras.txt").write_text("1 PINHOLE 8 6 9 9 4 3\n")
    lines = [f"{k + 1} 1 0 0 0 0 0 2 1 {name}\n\n" for k, name in enumerate(names)]
    (folder / "images.txt").write_text("".join(lines))
    return folder


def transforms(folder: Path, names: tuple[str, ...]) -> Path:
    frames = [{"file_path": name, "transform_matrix": np.eye(4).tolist()} for name in names]
    (folder / "transforms.json").write_text(json.dumps({"w": 8, "h": 6, "fl_x": 9, "frames": frames}))
    return folder / "transforms.json"


def test_a_folder_of_photographs_is_no_model(tmp_path: Path):
    files = photographs(tmp_path)
    colmap(tmp_path / "sparse" / "0")
    assert find_source(tmp_path, None) == Source(files, False, None)
    assert has_unused_cameras(find_source(tmp_path, None))
    assert find_source(tmp_path, tmp_path / "sparse") == Source(files, False, tmp_path / "sparse")
    assert not has_unused_cameras(find_source(tmp_path, tmp_path / "sparse"))
    alone = photographs(tmp_path / "alone")
    assert not has_unused_cameras(find_source(alone[0].parent, None))
    (tmp_path / "film.mp4").touch()
    assert find_source(tmp_path / "film.mp4", None) == Source((tmp_path / "film.mp4",), True, None)


def test_what_is_not_read_beside_the_photographs_is_said(tmp_path: Path):
    photographs(tmp_path / "photos")
    (tmp_path / "photos" / "d.dng").touch()
    said: list[str] = []
    # Without a detector or landmarks, nothing else is done.
    with pytest.raises(InputError, match="--detector"):
        prepare(PrepareRequest(tmp_path / "photos", tmp_path / "capture"), said.append)
    assert said == ["Left out, because such files are not read: 'd.dng'; export them as JPEG or PNG."]


@pytest.mark.parametrize("given", [".", "sparse", "sparse/0"])
@pytest.mark.parametrize("images", ["images", "."])
def test_a_colmap_model_says_where_its_images_are(tmp_path: Path, given: str, images: str):
    colmap(tmp_path / "sparse" / "0", ("left/a.png", "left/b.png", "right/c.png"))
    files = photographs(tmp_path / images, ("left/a.png", "left/b.png", "right/c.png"))
    found = find_source(tmp_path / given, None)
    assert [file.resolve() for file in found.files] == [file.resolve() for file in files]
    assert found.cameras == tmp_path / given


@pytest.mark.parametrize("given", [".", "transforms.json"])
def test_transforms_name_their_images(tmp_path: Path, given: str):
    path = transforms(tmp_path, ("shots/b.png", "shots/a.png", "shots/c"))
    files = photographs(tmp_path / "shots", ("b.png", "a.png", "c.png", "not_listed.png"))[:3]
    assert find_source(path.parent / given, None) == Source(files, False, path.parent / given)


@pytest.mark.parametrize("name", ["cameras.xml", "cameras.csv"])
def test_other_models_are_looked_for_beside_their_photographs(tmp_path: Path, name: str):
    (tmp_path / name).touch()
    with pytest.raises(InputError, match=rf"expected the photographs of .* beside it, .* --cameras .*{name}\."):
        find_source(tmp_path / name, None)
    files = photographs(tmp_path)
    assert find_source(tmp_path / name, None) == Source(files, False, tmp_path / name)


def test_missing_photographs_are_told(tmp_path: Path):
    colmap(tmp_path / "sparse" / "0")
    with pytest.raises(InputError, match=r"beside it, found no .*images/a\.png; name the folder of .* --cameras"):
        find_source(tmp_path, None)
    transforms(tmp_path, ("shots/a.png",))
    with pytest.raises(InputError, match=r"beside it, found no .*shots/a\.png"):
        find_source(tmp_path / "transforms.json", None)
    (tmp_path / "notes.txt").touch()
    for path, found in ((tmp_path / "notes.txt", "another file"), (tmp_path / "none", "nothing")):
        with pytest.raises(InputError, match=f"expected a folder of photographs, .*found {found}"):
            find_source(path, None)


def test_photographs_of_the_same_name_are_refused(tmp_path: Path):
    colmap(tmp_path / "sparse" / "0", ("left/a.png", "right/a.png", "right/c.png"))
    with pytest.raises(InputError, match=r"expected one camera for each photograph's name, found 2 for a\.png"):
        read_cameras(tmp_path, [])


def test_a_model_is_prepared_as_its_photographs_with_its_cameras_are(tmp_path: Path):
    scene = write_scene(tmp_path)
    model, dataset = tmp_path / "dataset" / "sparse" / "0", tmp_path / "dataset"
    model.mkdir(parents=True)
    write_colmap(model, scene)
    shutil.copytree(scene.folder / "photos", dataset / "images")
    given = scene.request(tmp_path / "given", cameras=dataset, bend=False)
    found = scene.request(tmp_path / "found", photographs=dataset, cameras=None, bend=False)
    assert prepare(given, lambda _: None) == prepare(found, lambda _: None)
    for name in ("transforms.json", "head.obj"):
        assert (tmp_path / "found" / name).read_bytes() == (tmp_path / "given" / name).read_bytes()
    inside = scene.request(tmp_path / "found", photographs=tmp_path / "found" / "transforms.json", cameras=None)
    with pytest.raises(InputError, match="expected a folder outside"):
        prepare(inside, print)


def write_colmap(model: Path, scene: Scene) -> None:
    """Write the scene's cameras as text, in metres."""
    rows = [f"{k + 1} {quaternion(camera)} 1 {camera.name}\n\n" for k, camera in enumerate(scene.cameras)]
    (model / "images.txt").write_text("".join(rows))
    first = scene.cameras[0]
    values = first.intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    text = " ".join(str(value) for value in values)
    (model / "cameras.txt").write_text(f"1 PINHOLE {first.width} {first.height} {text}\n")


def quaternion(camera: Camera) -> str:
    """The pose as COLMAP writes it: quaternion (w, x, y, z) and translation."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(camera.rotation.double().numpy()).as_quat()
    values = (w, x, y, z, *camera.world_to_camera[:3, 3].tolist())
    return " ".join(str(float(value)) for value in values)
