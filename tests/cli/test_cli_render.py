"""`render`, run as a user runs it on a small model."""

import json
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
import torch
from full_disk import smallest_files
from PIL import Image

from neural_strands.cli.commands.render import picture_name
from neural_strands.cli.main import main
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.model.files import load_hair_model, save_hair_model
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.surround.body import SurroundConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.scalp.roots import Roots


@pytest.fixture
def saved(tmp_path):
    """A model of 40 strands on a disc, without a body."""
    random = torch.Generator().manual_seed(0)
    position = torch.rand(40, 3, generator=random) * torch.tensor([0.1, 0.0, 0.1])
    frame = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]).T.expand(40, 3, 3).contiguous()
    config = HairModelConfig(
        ScalpTextureConfig(shape_size=4, appearance_size=4, appearance_channels=2),
        UNetConfig(widths=(4, 4)),
        SurroundConfig(background_texture=4, background_directions=6),
        points=8,
    )
    nobody = Mesh(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int64))
    roots = Roots(position, position[:, [0, 2]] * 10, frame, torch.zeros(40))
    save_hair_model(HairModel(config, roots, StrandGenerator(), nobody, random), tmp_path / "hair")
    return tmp_path / "hair"


def transforms(folder):
    frame = {"file_path": "images/left.png", "transform_matrix": np.diag([1.0, 1, 1, 1]).tolist()}
    frame["transform_matrix"][2][3] = 1.0
    path = folder / "transforms.json"
    path.write_text(json.dumps({"w": 31, "h": 20, "fl_x": 60.0, "frames": [frame]}))
    return path


def test_given_cameras_give_images_of_their_names_and_sizes(saved, tmp_path, capsys):
    out = tmp_path / "views"
    assert main(["render", str(saved), "--camera", str(transforms(tmp_path)), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 1
    assert sorted(path.name for path in out.iterdir()) == ["left.png", "render.json"]
    picture = cv2.imread(str(out / "left.png"), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (20, 31, 3)


def test_grain_is_drawn_over_the_hair_when_asked_for_the_same_in_every_run(saved, tmp_path):
    """Every frame has grain of its own; what is not hair stays as it was."""
    pictures = {}
    for name, more in (("clean", []), ("grainy", ["--grain", "1"]), ("again", ["--grain", "1"])):
        out = tmp_path / name
        assert main(["render", str(saved), "--turntable", "2", "--size", "40", "30", "--out", str(out), *more]) == 0
        frames = sorted(out.glob("*.png"))
        pictures[name] = np.stack([np.asarray(Image.open(frame)) for frame in frames]).astype(float)
    assert np.array_equal(pictures["grainy"], pictures["again"])
    change = pictures["grainy"] - pictures["clean"]
    opacity = tmp_path / "alpha"
    assert main(["render", str(saved), "--turntable", "2", "--size", "40", "30", "--alpha", "--out", str(opacity)]) == 0
    alpha = np.stack([np.asarray(Image.open(frame))[..., 3] for frame in sorted(opacity.glob("*.png"))])
    bare = alpha <= 2
    assert bare.any()
    assert np.abs(change[bare]).max() <= 1
    assert change[alpha > 200].std() > 2
    assert not np.array_equal(change[0], change[1])


def test_frames_of_the_same_name_in_six_folders_give_six_pictures(saved, tmp_path, capsys):
    path = transforms(tmp_path)
    document = json.loads(path.read_text())
    names = [f"cam{k}/000.png" for k in range(6)]
    document["frames"] = [document["frames"][0] | {"file_path": name} for name in names]
    path.write_text(json.dumps(document))
    out = tmp_path / "views"
    assert main(["render", str(saved), "--camera", str(path), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 6
    assert sorted(picture.relative_to(out).as_posix() for picture in out.rglob("*.png")) == names


def test_pictures_have_names_of_their_own_inside_the_folder():
    taken: set[str] = set()
    cameras = ["a.jpg", "a.png", "../../a.png", "/etc/b", "left/a.png", "left\\a.png", "..", "", "a.b.png", "a_2"]
    names = [picture_name(camera, taken) for camera in cameras]
    assert names == [
        *("a.png", "a_2.png", "a_3.png", "etc/b.png", "left/a.png", "left/a_2.png"),
        *("view.png", "view_2.png", "a.b.png", "a_2_2.png"),
    ]


def test_alpha_is_that_of_the_hair(saved, tmp_path):
    out = tmp_path / "views"
    words = ["--turntable", "2", "--size", "48", "40", "--alpha", "--out", str(out)]
    assert main(["render", str(saved), *words]) == 0
    assert sorted(path.name for path in out.glob("*.png")) == ["0000.png", "0001.png"]
    picture = cv2.imread(str(out / "0001.png"), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (40, 48, 4)
    model = load_hair_model(saved)
    with torch.no_grad():
        strands = model.decode()
        output = model.render(strands, turntable_cameras(strands.points, 2, (48, 40))[1])
    np.testing.assert_allclose(picture[..., 3], 255 * output.alpha.numpy(), atol=0.51)


def test_files_of_the_user_are_refused_and_images_of_an_earlier_rendering_replaced(saved, tmp_path, capsys):
    out = tmp_path / "images"
    out.mkdir()
    words = ["render", str(saved), "--camera", str(transforms(tmp_path)), "--out", str(out)]
    # A photograph of the camera's own name, as in the capture that the cameras come from.
    (out / "left.png").write_bytes(b"a photograph")
    assert main(words) == 2
    said = capsys.readouterr()
    assert f"{out}: expected a new or empty folder, or one that render wrote to, found another; name a" in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert {path.name: path.read_bytes() for path in out.iterdir()} == {"left.png": b"a photograph"}
    (out / "left.png").rename(out / ".DS_Store")
    assert main(words) == 0
    first = cv2.imread(str(out / "left.png"), cv2.IMREAD_UNCHANGED)
    (out / "notes.txt").write_text("kept")
    assert main([*words, "--alpha"]) == 0
    assert [cv2.imread(str(out / "left.png"), cv2.IMREAD_UNCHANGED).shape, first.shape] == [(20, 31, 4), (20, 31, 3)]
    assert (out / "notes.txt").read_text() == "kept"


def test_a_file_where_the_folder_belongs_is_refused(saved, tmp_path, capsys):
    (tmp_path / "views").write_text("notes")
    assert main(["render", str(saved), "--turntable", "1", "--out", str(tmp_path / "views")]) == 2
    assert "views: expected a new or empty folder" in capsys.readouterr().err
    assert (tmp_path / "views").read_text() == "notes"


def test_a_video_has_every_frame(saved, tmp_path):
    out = tmp_path / "turn.mp4"
    assert main(["render", str(saved), "--turntable", "5", "--size", "65", "48", "--out", str(out)]) == 0
    video = cv2.VideoCapture(str(out))
    shapes = []
    while (read := video.read())[0]:
        shapes.append(read[1].shape)
    assert shapes == [(48, 64, 3)] * 5


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "x"], "either --camera or --turntable"),
        (["--out", "x", "--turntable", "0"], "--turntable: expected a whole number from 1 to 100000, found 0"),
        (["--out", "x", "--turntable", "1000000000"], "--turntable: expected a whole number from 1 to 100000"),
        (["--out", "x", "--turntable", "1", "--size", "16384", "16384"], "a frame of 16384 x 16384 pixels: expected"),
        (["--out", "x.mp4", "--turntable", "1", "--alpha"], "no alpha channel"),
        (["--out", "x.avi", "--turntable", "1"], "ends in .avi"),
        (["--out", "x.png", "--turntable", "1"], "a file that ends in .mp4"),
        (["--out", "x", "--turntable", "1", "--size", "0", "5"], "--size"),
        (["--out", "x", "--turntable", "1", "--points", "1"], "--points"),
        (["--out", "x", "--turntable", "1", "--points", "1000000000"], "--points: expected a whole number from 2 to"),
        (["--out", "x.mp4", "--turntable", "1", "--fps", "0"], "--fps: expected a finite number from 1.0 to 240.0"),
        (["--out", "x.mp4", "--turntable", "1", "--fps", "1e9"], "--fps: expected a finite number from 1.0 to 240.0"),
        (["--out", "x", "--camera", "nowhere.json"], "found no file"),
    ],
)
def test_bad_arguments_are_one_sentence(saved, capsys, words, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(saved), *words]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.err.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_a_full_disk_is_one_sentence_and_leaves_no_broken_image(saved, tmp_path, capsys):
    out = tmp_path / "views"
    rendering = ["render", str(saved), "--turntable", "1", "--out"]
    assert main([*rendering, str(tmp_path / "before")]) == 0  # compiles the kernels
    capsys.readouterr()
    with smallest_files(100):
        assert main([*rendering, str(out)]) == 2
    assert "cannot be written" in capsys.readouterr().err.splitlines()[-1]
    assert not list(out.glob("*.png"))


def test_kernels_that_cannot_be_stored_are_one_sentence(saved, tmp_path):
    blocked = tmp_path / "cache"
    blocked.write_text("a file where the folder belongs")
    words = ["render", str(saved), "--turntable", "1", "--out", str(tmp_path / "views")]
    environment = {**os.environ, "WARP_CACHE_PATH": str(blocked)}
    run = [sys.executable, "-m", "neural_strands", *words]
    done = subprocess.run(run, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "WARP_CACHE_PATH" in done.stderr
    assert done.stderr.count("\n") == 1
