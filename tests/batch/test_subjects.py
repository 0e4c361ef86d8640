"""Files of subjects: what they contain, and one sentence for each possible mistake."""

import pytest

from neural_strands.batch.subjects import Demand, read_subjects
from neural_strands.fitting.config import preset
from neural_strands.foundation.errors import InputError

WHOLE = """
[defaults]
preset = "demo"
config.weights.alpha = 0.3
prepare.pupil_distance = 63

[resources.fit]
cores = 4
gpu = 0.5

[subjects.bob]
photographs = "photos/bob"
prepare.landmarks = "bob.json"

[subjects.Eve-2]
capture = "s3://heads/eve"
segments = "eve.npz"
preset = "fast"
config.steps = 7
"""


def read(tmp_path, text):
    path = tmp_path / "subjects.toml"
    path.write_text(text)
    return read_subjects(path)


def test_a_subject_stands_on_the_defaults(tmp_path):
    found = read(tmp_path, WHOLE)
    bob, eve = found.subjects
    assert (bob.name, bob.source, bob.prepared) == ("bob", str(tmp_path / "photos" / "bob"), False)
    assert (eve.name, eve.source, eve.prepared) == ("Eve-2", "s3://heads/eve", True)
    assert bob.prepare.pupil_distance == eve.prepare.pupil_distance == 63
    assert bob.prepare.landmarks == str(tmp_path / "bob.json")
    assert bob.config.weights.alpha == eve.config.weights.alpha == 0.3
    assert (bob.config.steps, eve.config.steps) == (preset("demo").steps, 7)
    assert bob.config.strands == preset("demo").strands
    assert eve.config.strands == preset("fast").strands
    assert eve.segments == str(tmp_path / "eve.npz")
    assert found.demands.fit == Demand(4, 0.5)
    assert found.demands.prepare.gpu == 0


def test_what_is_given_is_not_made(tmp_path):
    bob, eve = read(tmp_path, WHOLE).subjects
    assert bob.stages == ("prepare", "lmvs", "fit", "evaluate")
    assert eve.stages == ("fit", "evaluate")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "a value under 'subjects'"),
        ("[subjects]", "subjects: expected 1 to 100000, found 0"),
        ("[subjects", "expected settings as TOML"),
        ("[people.bob]", "people: expected no other table than subjects, defaults, resources"),
        ("[subjects]\nbob = 3", "an object in braces"),
        ("[subjects.bob]", "either photographs or a capture"),
        ('[subjects.bob]\ncapture = "a"\nphotographs = "b"', "either photographs or a capture"),
        ('[subjects."../bob"]\ncapture = "a"', "a name of its own"),
        ('[subjects."bob."]\ncapture = "a"', "a name of its own"),
        ('[subjects.bob]\ncapture = "a"\n[subjects.Bob]\ncapture = "a"', "a name of its own"),
        ("[subjects.bob]\ncapture = 3", "subjects.bob.capture: expected the path of a file"),
        ('[subjects.bob]\ncapture = "a"\ncapure = 1', "subjects.bob.capure: expected one of photographs, capture"),
        ('[subjects.bob]\ncapture = "a"\npreset = "slow"', "preset: expected one of demo, fast, paper"),
        ('[subjects.bob]\ncapture = "a"\nconfig.step = 3', "such as steps"),
        ('[subjects.bob]\ncapture = "a"\nconfig.steps = 0', "config.steps: expected a whole number from 1"),
        ('[subjects.bob]\ncapture = "a"\nconfig.crop = 16', "crop: expected at least"),
        ('[subjects.bob]\ncapture = "a"\nprepare.pupil_distance = 6', "a finite number from 40.0 to 85.0"),
        ('[defaults]\ncapture = "a"\n[subjects.bob]', "not the files of one"),
        ('[resources.fits]\ncores = 1\n[subjects.bob]\ncapture = "a"', "such as fit"),
        ('[resources.fit]\ncores = 0\n[subjects.bob]\ncapture = "a"', "a whole number from 1 to 1024"),
    ],
)
def test_whatever_is_wrong_is_one_sentence(text, sentence, tmp_path):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert sentence in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "subjects.toml"))
    assert str(caught.value).count("; ") >= 1
    assert "\n" not in str(caught.value)
