"""Names of photographs without suffix, against a list written by hand."""

import pytest

from neural_strands.preparation.photographs.names import stem_of


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("IMG_1.JPG", "img_1"),
        ("IMG_1.CR2", "img_1"),
        ("img_1", "img_1"),
        ("left/IMG_1.heic", "img_1"),
        ("at 14.30.22", "at 14.30.22"),
        ("at 14.30.22 (1).jpeg", "at 14.30.22 (1)"),
        ("clip.mp4 frame 12", "clip.mp4 frame 12"),
        ("Jörg.Profil.png", "jörg.profil"),
    ],
)
def test_only_suffixes_of_pictures_are_dropped(name: str, stem: str):
    assert stem_of(name) == stem
