"""The report page and its pictures."""

import base64
import re

import cv2
import numpy as np
import pytest
import torch

from neural_strands.evaluation.page import Gallery, Table, Turntable, write_page
from neural_strands.evaluation.pictures import PAPER, curves, difference, geometry_picture, png, strip
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh


def decoded(data):
    return torch.from_numpy(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1].copy())


def test_png_is_the_image_rounded_to_bytes(generator):
    image = torch.rand(5, 7, 3, generator=generator) * 1.2 - 0.1
    torch.testing.assert_close(decoded(png(image)), (image.clamp(0, 1) * 255).round().byte())


def test_difference_is_dark_where_images_agree_and_saturates():
    image = torch.zeros(2, 2, 3)
    other = image.clone()
    other[0, 0] = 0.25
    heat = difference(image, other, gain=4.0)
    assert heat[1, 1].max() < 0.02
    torch.testing.assert_close(heat[0, 0], torch.tensor([0.988, 0.998, 0.645]), atol=2e-3, rtol=0)


def test_geometry_picture_colours_strands_by_direction_and_hides_what_the_head_hides():
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 100.0, (32, 32))
    upright = torch.tensor([[[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]])
    picture = geometry_picture(upright, camera)
    column = picture[16, :, :]
    inked = (column - PAPER).abs().sum(dim=-1) > 0.05
    assert 1 <= int(inked.sum()) <= 2
    # A pixel half covered: the mean of white and of 0.5 + 0.5 * (0, 1, 0).
    assert column[inked][0, 1] > column[inked][0, 0]
    wall = Mesh(
        torch.tensor([[-1.0, -1.0, 0.1], [1.0, -1.0, 0.1], [1.0, 1.0, 0.1], [-1.0, 1.0, 0.1]]),
        torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    hidden = geometry_picture(upright, camera, wall)
    assert float(hidden.reshape(-1, 3).std(dim=0).max()) < 1e-6


def test_curves_are_a_picture():
    image = decoded(curves({"a": [(1.0, 0.5), (2.0, 0.25)], "b": []}, "losses"))
    assert image.shape[2] == 3
    assert image.float().std() > 1


def test_page_holds_tables_and_pictures_and_escapes_text(tmp_path, generator):
    picture = png(torch.rand(3, 4, 3, generator=generator))
    table = Table("Figures", ("", "PSNR"), (("view <0>", "30.1"),), note="a & b")
    write_page(tmp_path / "page.html", "Title", "Summary", [table], [Gallery("Views", (("one", picture),))])
    page = (tmp_path / "page.html").read_text()
    assert "view &lt;0&gt;" in page
    assert "a &amp; b" in page
    (embedded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert base64.b64decode(embedded) == picture
    assert not re.search(r"(src|href)=\"(?!data:)", page)


def test_a_turntable_holds_its_frames_one_below_the_other(tmp_path):
    frames = [torch.full((8, 8, 3), level) for level in (0.2, 0.5, 0.8)]
    turntable = Turntable("Turntable", (("rendered", strip(frames)),), len(frames), seconds=2.0)
    write_page(tmp_path / "page.html", "Title", "Summary", [], [], turntable)
    page = (tmp_path / "page.html").read_text()
    (embedded,) = re.findall(r"url\(data:image/webp;base64,([^)]+)\)", page)
    image = decoded(base64.b64decode(embedded))
    assert image.shape == (24, 8, 3)
    torch.testing.assert_close(image[4::8, 4, 0], torch.tensor([51, 128, 204], dtype=torch.uint8), atol=3, rtol=0)
    assert "turn 2.0s steps(3, jump-none) infinite" in page
    assert "background-size: 100% 300%" in page
    assert 'max="2"' in page


def test_images_that_are_none_are_refused():
    with pytest.raises(cv2.error):
        png(torch.zeros(0, 3, 3))
