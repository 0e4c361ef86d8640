"""The report page: tables, galleries and the turntable, with everything embedded."""

import base64
import re

import cv2
import numpy as np
import torch
from html_page import ReportPage

from neural_strands.evaluation.page import Gallery, Table, Turntable, write_page
from neural_strands.pictures.encoding import encode_png, encode_webp


def decoded(data):
    return torch.from_numpy(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1].copy())


def test_page_holds_tables_and_pictures_and_escapes_text(tmp_path, generator):
    picture = encode_png(torch.rand(3, 4, 3, generator=generator))
    table = Table("Figures", ("", "PSNR"), (("view <0>", "30.1"),), note="a & b")
    write_page(tmp_path / "page.html", "Title", "Summary", [table], [Gallery("Views", (("one", picture),))])
    page = (tmp_path / "page.html").read_text()
    assert "view &lt;0&gt;" in page
    assert "a &amp; b" in page
    (embedded,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert base64.b64decode(embedded) == picture
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    read = ReportPage(page)
    assert read.tables == {"Figures": [["", "PSNR"], ["view <0>", "30.1"]]}
    ((caption, shown),) = read.pictures
    assert caption == "one"
    np.testing.assert_array_equal(shown, decoded(picture).numpy())
    assert all(address.startswith("data:") for address in read.addresses)


def test_a_turntable_holds_its_frames_one_below_the_other(tmp_path):
    frames = [torch.full((8, 8, 3), level) for level in (0.2, 0.5, 0.8)]
    turntable = Turntable("Turntable", (("rendered", encode_webp(torch.cat(frames))),), len(frames), seconds=2.0)
    write_page(tmp_path / "page.html", "Title", "Summary", [], [], turntable)
    page = (tmp_path / "page.html").read_text()
    (embedded,) = re.findall(r"url\(data:image/webp;base64,([^)]+)\)", page)
    image = decoded(base64.b64decode(embedded))
    assert image.shape == (24, 8, 3)
    torch.testing.assert_close(image[4::8, 4, 0], torch.tensor([51, 128, 204], dtype=torch.uint8), atol=3, rtol=0)
    assert "turn 2.0s steps(3, jump-none) infinite" in page
    assert "background-size: 100% 300%" in page
    assert 'max="2"' in page
