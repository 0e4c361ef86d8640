"""Hair masks found by colour and texture, on path-traced hair with true masks."""

from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.cli.main import main
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.preparation.head.builtin import STORED
from neural_strands.preparation.masks.hair import find_hair
from neural_strands.preparation.masks.zones import ZonedHead
from neural_strands.preparation.photographs.folder import write_picture
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.head import Head
from neural_strands.scalp.mannequin import mannequin

DARK = 0.14
"""Light that clothes reflect, as a share of what the mannequin's skin does: about as dark as the demo's brown hair."""
COLLAR = 0.02
"""Where clothes begin, metres below the chin."""


@pytest.fixture(scope="module")
def demo_capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """The demo's photographs, which nobody has to render."""
    folder = tmp_path_factory.mktemp("demo_capture")
    assert main(["synthesize", str(folder), "--style", "straight", "--shipped"]) == 0
    return Capture.load(folder)


def dressed(capture: Capture, view: int, head: Head, top: float) -> Float[Tensor, "height width 3"]:
    """The photograph with clothes on all of the body below `top`."""
    buffer = rasterise_triangles(head.mesh.vertices, head.mesh.faces, capture.cameras[view])
    height = (head.mesh.vertices[head.mesh.faces[buffer.face.clamp(min=0)], 1] * buffer.barycentric).sum(dim=-1)
    hair, person = capture.hair_mask(view), capture.person_mask(view)
    assert hair is not None
    assert person is not None
    share = (person - hair).clamp(0, 1) * ((buffer.face >= 0) & (height < top))
    return to_srgb(to_linear(capture.image(view)) * (1 - (1 - DARK) * share[..., None]))


@pytest.mark.slow
def test_clothes_as_dark_as_the_hair_are_not_taken_for_it(demo_capture: Capture, tmp_path: Path) -> None:
    with np.load(STORED, allow_pickle=False) as stored:
        landmarks = torch.from_numpy(stored["landmarks"])
    zoned = ZonedHead.of(mannequin(), landmarks)
    pictures, outlines = [], []
    for view in range(len(demo_capture)):
        picture = dressed(demo_capture, view, zoned.head, zoned.chin - COLLAR)
        for folder, image, paths in (
            ("pictures", picture, pictures),
            ("outlines", demo_capture.person_mask(view), outlines),
        ):
            assert image is not None
            paths.append(tmp_path / folder / f"{view:03d}.png")
            paths[-1].parent.mkdir(exist_ok=True)
            write_picture(paths[-1], (image * 255).round().byte().numpy())
    found = find_hair(demo_capture.cameras, pictures, zoned, outlines)
    overlaps = []
    for view, coverage in enumerate(found.coverage):
        true = demo_capture.hair_mask(view)
        assert true is not None
        hair, mask = true.numpy() > 0.5, coverage > 127
        overlaps.append((hair & mask).sum() / (hair | mask).sum())
    # 0.87, and 0.82 if clothes share the histogram of skin.
    assert np.mean(overlaps) > 0.85
