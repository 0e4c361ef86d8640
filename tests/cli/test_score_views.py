"""`score-views`: photographs with known changes as renderings, and our own renderings against `evaluate`."""

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from tiny_capture import SIDE, tiny_config, true_segments, write_capture

from neural_strands.cli.main import main
from neural_strands.fitting import config as fit_config
from neural_strands.lmvs.files import save_segments
from neural_strands.runs.evaluate import GRAIN

CHANGE = 10


@pytest.fixture
def ball(tmp_path, monkeypatch):
    """A capture of six views, and renderings that are CHANGE levels too bright in the hair and correct elsewhere."""
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    write_capture(tmp_path / "ball")
    (tmp_path / "shown").mkdir()
    for path in (tmp_path / "ball" / "images").iterdir():
        write(tmp_path / "shown" / path.name, brighter(path))
    return tmp_path


def mask_of(image_path):
    mask = cv2.imread(str(image_path.parents[1] / "masks" / image_path.name), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    return mask


def brighter(path):
    """The photograph, CHANGE levels brighter where there is hair."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    assert image is not None
    return np.where(mask_of(path)[..., None] > 127, image + CHANGE, image).astype(np.uint8)


def write(path, pixels):
    assert cv2.imwrite(str(path), pixels)


def scores(capsys, *words):
    assert main(["score-views", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_known_error_in_the_hair_is_found_there(ball, capsys):
    result = scores(capsys, ball / "shown", ball / "ball")
    (view,) = result["views"]
    assert view["name"] == "004.png"
    in_hair = -20 * math.log10(CHANGE / 255)
    assert view["hair"]["psnr"] == pytest.approx(in_hair, abs=1e-3)
    share = (mask_of(ball / "ball" / "images" / "004.png") > 127).mean()
    assert view["image"]["psnr"] == pytest.approx(in_hair - 10 * math.log10(share), abs=1e-3)
    assert 0 < view["hair"]["ssim"] < view["image"]["ssim"] < 1
    assert view["alpha"] is None
    assert result["mean"]["hair"] == view["hair"]
    assert result["lpips"]["network"] == "squeeze"
    assert result["lpips"]["training_loss_of_fit"] is True


def test_all_views_or_another_interval(ball, capsys):
    names = [view["name"] for view in scores(capsys, ball / "shown", ball / "ball", "--all-views")["views"]]
    assert names == [f"{k:03d}.png" for k in range(6)]
    names = [view["name"] for view in scores(capsys, ball / "shown", ball / "ball", "--every", "3")["views"]]
    assert names == ["002.png", "005.png"]


def test_alpha_is_judged_where_it_says_anything(ball, capsys):
    """The mask faded by a quarter, and widened to the whole upper half; then a channel that is opaque everywhere."""
    path = ball / "ball" / "images" / "004.png"
    mask = mask_of(path)
    alpha = np.where(mask > 127, 192, 0).astype(np.uint8)
    alpha[: SIDE // 2] = 255
    write(ball / "shown" / "004.png", np.dstack([brighter(path), alpha]))
    found = scores(capsys, ball / "shown", ball / "ball")["views"][0]
    assert found["alpha"]["mean_absolute_error"] == pytest.approx(np.abs(alpha / 255 - mask / 255).mean(), abs=1e-5)
    overlap, union = ((alpha > 127) & (mask > 127)).sum(), ((alpha > 127) | (mask > 127)).sum()
    assert found["alpha"]["outline_iou"] == pytest.approx(overlap / union)
    assert found["hair"]["psnr"] == pytest.approx(-20 * math.log10(CHANGE / 255), abs=1e-3)
    write(ball / "shown" / "004.png", np.dstack([brighter(path), np.full_like(alpha, 255)]))
    assert scores(capsys, ball / "shown", ball / "ball")["views"][0]["alpha"] is None


def test_equal_images_have_no_finite_psnr(ball, capsys):
    result = scores(capsys, ball / "ball" / "images", ball / "ball")
    assert result["mean"]["image"]["psnr"] is None
    assert result["mean"]["image"]["ssim"] == pytest.approx(1.0)


def test_the_table_says_what_was_trained_on(ball, capsys):
    assert main(["score-views", str(ball / "shown"), str(ball / "ball"), "--every", "3"]) == 0
    out = capsys.readouterr().out
    lines = out.splitlines()
    assert [line.split()[0] for line in lines[:4]] == ["view", "002.png", "005.png", "mean"]
    assert f"{-20 * math.log10(CHANGE / 255):.2f}" in lines[1]
    assert "LPIPS (squeeze) is absent" in out
    assert "also a training loss of `neural-strands fit`" in out
    assert main(["score-views", str(ball / "shown"), str(ball / "ball"), "--lpips", "alex"]) == 0
    assert "training loss" not in capsys.readouterr().out


def test_our_own_renderings_score_as_evaluate_says(ball, capsys, monkeypatch):
    """Except for the rounding to 8 bits; the capture's own cameras are those of its transforms.json."""
    save_segments(ball / "segments.npz", true_segments(write_capture(ball / "again")))
    monkeypatch.setattr(fit_config, "preset", lambda _: replace(tiny_config(), steps=8))
    run = ball / "run"
    assert main(["fit", str(ball / "ball"), str(run), "--segments", str(ball / "segments.npz")]) == 0
    assert main(["evaluate", str(run), "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])["held_out_views"]
    assert told["count"] == 1
    cameras = ["--camera", str(ball / "ball" / "transforms.json")]
    for out, grain, hair, image in (
        ("clean", 0.0, told["without_grain"]["hair"], told["without_grain"]["image"]),
        ("grainy", GRAIN, told, told["image"]),
    ):
        more = ["--grain", str(grain), "--out", str(ball / out)]
        assert main(["render", str(run / "model"), *cameras, *more]) == 0
        capsys.readouterr()
        found = scores(capsys, ball / out, ball / "ball")["mean"]
        for name, digits in (("psnr", 0.02), ("ssim", 2e-3)):
            assert found["hair"][name] == pytest.approx(hair[name], abs=digits)
            assert found["image"][name] == pytest.approx(image[name], abs=digits)
    assert 0 < told["alpha"]["outline_iou"] <= 1
    assert "training loss" in told["lpips_note"] or "absent" in told["lpips_note"]


def lose_rendering(ball):
    (ball / "shown" / "004.png").unlink()


def lose_renderings(ball):
    for path in (ball / "shown").iterdir():
        path.unlink()


def shrink_rendering(ball):
    write(ball / "shown" / "004.png", np.zeros((SIDE // 2, SIDE, 3), np.uint8))


def break_rendering(ball):
    (ball / "shown" / "004.png").write_bytes(b"no image")


def double_rendering(ball):
    write(ball / "shown" / "004.jpg", np.zeros((SIDE, SIDE, 3), np.uint8))


def lose_masks(ball):
    document = json.loads((ball / "ball" / "transforms.json").read_text())
    for frame in document["frames"]:
        (ball / "ball" / frame.pop("mask_path")).unlink()
    (ball / "ball" / "transforms.json").write_text(json.dumps(document))


def lose_folder(ball):
    (ball / "shown").rename(ball / "elsewhere")


def nothing(_):
    pass


@pytest.mark.parametrize(
    ("harm", "words", "message"),
    [
        (lose_rendering, [], "expected a rendering of each of 1 views, found none of 004; name it 004.png"),
        (lose_renderings, ["--every", "3"], "found none of 002 and 1 more"),
        (shrink_rendering, [], "expected 64 x 64 pixels, as its view has, found 64 x 32"),
        (break_rendering, [], "004.png: expected an image such as"),
        (double_rendering, [], "found 004.jpg and 004.png; remove all but one"),
        (lose_masks, [], "expected a hair mask of each view, found none of 004"),
        (lose_folder, [], "expected a folder of renderings, found none"),
        (nothing, ["--every", "7"], "expected at least 7 views, one of them held out, found 6"),
        (nothing, ["--every", "0"], "--every: expected 1 or more, found 0"),
    ],
)
def test_bad_input_is_one_sentence(ball, capsys, harm, words, message):
    harm(ball)
    assert main(["score-views", str(ball / "shown"), str(ball / "ball"), *words]) == 2
    told = capsys.readouterr()
    assert message in told.err
    assert told.err.count("\n") == 1
    assert told.out == ""
