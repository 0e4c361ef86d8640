"""The contact sheet shows every view, with the borders of its masks and of the head."""

from pathlib import Path

import cv2
import numpy as np
from tiny_capture import write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.contact_sheet import CAPTION, DIMMED, HAIR, HEAD, write_contact_sheet
from neural_strands.capture.head import read_head
from neural_strands.cli.main import main


def read(path: Path) -> np.ndarray:
    return cv2.imread(str(path))[..., ::-1]


def test_borders_lie_where_masks_and_head_end(tmp_path: Path):
    folder = tmp_path / "ball"
    write_capture(folder, views=6)
    capture = Capture.load(folder)
    head = read_head(capture)
    assert head is not None
    write_contact_sheet(tmp_path / "sheet.png", capture, head.mesh, head.scalp_faces)
    sheet = read(tmp_path / "sheet.png")
    height, width = capture.cameras[0].height, capture.cameras[0].width
    assert sheet.shape[0] % (height + CAPTION) == 0
    assert sheet.shape[1] % width == 0
    assert (sheet.shape[0] // (height + CAPTION)) * (sheet.shape[1] // width) >= 6
    tile = sheet[:height, :width].astype(int)
    hair = capture.hair_mask(0)
    assert hair is not None
    inside = (hair.numpy() > 0.5).astype(np.uint8)
    border = inside - cv2.erode(inside, np.ones((3, 3), np.uint8))
    green = (tile == HAIR).all(axis=-1)
    assert green.any()
    assert (border[green] == 1).mean() > 0.95
    assert (tile == HEAD).all(axis=-1).any()
    # Outside the hair, the photograph is dimmed.
    plain = capture.image(0).numpy() * 255
    drawn = (tile == HAIR).all(axis=-1) | (tile == HEAD).all(axis=-1) | (tile[..., 0] > tile[..., 1] + 100)
    outside = (hair.numpy() == 0) & ~drawn
    np.testing.assert_allclose(tile[outside], DIMMED * plain[outside], atol=2)


def test_check_draws_the_sheet_even_if_a_mask_is_damaged(tmp_path: Path, capsys):
    folder = tmp_path / "ball"
    write_capture(folder, views=6)
    next((folder / "masks").iterdir()).write_bytes(b"no picture")
    assert main(["check", str(folder), "--sheet", str(tmp_path / "sheet.png")]) == 2
    assert read(tmp_path / "sheet.png").size
    assert main(["check", str(folder), "--sheet", str(tmp_path / "sheet.jpg")]) == 2
    assert "expected a name that ends in .png" in capsys.readouterr().err
