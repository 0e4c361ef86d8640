"""The scale from lengths of the face."""

import math

import numpy as np
import pytest
from synthetic_face import arc, face_points, images_of

from neural_strands.preparation.face.scale import Scale, ScaleCue, combine, face_cues, landmark_distance
from neural_strands.preparation.face.topology import LEFT_IRIS, NAMED, RIGHT_IRIS
from neural_strands.preparation.face.triangulate import triangulate_face


def test_agreeing_cues_average_by_their_errors():
    scale = combine([ScaleCue("a", 0.065, 0.05), ScaleCue("b", 0.065, 0.05)])
    assert scale.metres_per_unit == pytest.approx(0.065)
    # Two independent 5 % errors, and the 2.5 % that all lengths of a head share.
    assert scale.error == pytest.approx(math.hypot(0.05 / math.sqrt(2), 0.025))


def test_one_cue_far_off_hardly_counts():
    cues = [ScaleCue(str(k), value, 0.05) for k, value in enumerate((0.064, 0.065, 0.066, 0.130))]
    assert combine(cues).metres_per_unit == pytest.approx(0.065, rel=0.01)


def test_the_scale_goes_with_the_unit():
    cues = [ScaleCue("a", 0.06, 0.05), ScaleCue("b", 0.07, 0.08), ScaleCue("c", 0.066, 0.04)]
    larger = [ScaleCue(cue.name, 10 * cue.metres_per_unit, cue.error) for cue in cues]
    assert combine(larger).metres_per_unit == pytest.approx(10 * combine(cues).metres_per_unit)
    with pytest.raises(ValueError, match="at least one"):
        combine([])


def test_sentences_state_the_error_that_remains():
    estimated = combine([ScaleCue("a", 0.065, 0.05)]).sentence()
    assert "65.0 mm per unit of the cameras, ± 5.6 % (a 65.0 ± 5 %)" in estimated
    # The distance of the pupils is known, but not exactly where they are; a unit that the user gives has no error.
    assert Scale(0.4, 0.008).sentence() == "Scale as given: 400.00 mm per unit of the cameras, ± 0.8 %."
    assert Scale(0.4, 0.0).sentence() == "Scale as given: 400.00 mm per unit of the cameras."


def test_a_mean_face_in_metres_has_scale_one():
    points = face_points()
    for border, eye in ((RIGHT_IRIS, "right_iris"), (LEFT_IRIS, "left_iris")):
        centre = points[NAMED[eye]]
        for k, index in enumerate(border):
            angle = 0.5 * np.pi * k
            points[index] = centre + 0.00585 * np.array([np.cos(angle), np.sin(angle), 0.0])
    cameras = arc()
    faces = images_of(points, cameras)
    face = triangulate_face(cameras, faces)
    assert landmark_distance(face, "right_iris", "left_iris")[0] == pytest.approx(0.063, rel=1e-3)
    cues = face_cues(face, cameras, faces)
    assert {cue.name for cue in cues} >= {"iris", "pupil distance", "face width", "mouth width", "nose bridge to chin"}
    for cue in cues:
        assert cue.metres_per_unit == pytest.approx(1.0, rel=0.02), cue.name
    assert combine(cues).metres_per_unit == pytest.approx(1.0, rel=0.01)
