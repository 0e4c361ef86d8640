"""Landmarks from several views: exact without noise, right among wrong detections, refused where two people agree."""

import numpy as np
import pytest
from synthetic_face import arc, face_points, images_of

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.face.topology import INTERIOR, LANDMARKS
from neural_strands.preparation.face.triangulate import project, projection_matrices, triangulate, triangulate_face


def test_two_exact_images_give_the_point():
    cameras, points = arc(2), face_points()
    pixels = np.stack([found[0] for found in images_of(points, cameras)])
    found = triangulate(projection_matrices(cameras), pixels, np.ones(pixels.shape[:2]))
    np.testing.assert_allclose(found, points, atol=2e-5)


def test_a_point_seen_once_is_not_known():
    cameras, points = arc(3), face_points()
    pixels = np.stack([found[0] for found in images_of(points, cameras)])
    pixels[1:, 7] = np.nan
    found = triangulate(projection_matrices(cameras), pixels, np.ones(pixels.shape[:2]))
    assert np.isnan(found[7]).all()
    assert np.isfinite(np.delete(found, 7, axis=0)).all()


def test_projection_agrees_with_the_camera():
    cameras, points = arc(2), face_points()
    images, depth = project(projection_matrices(cameras), points)
    np.testing.assert_allclose(images[0], images_of(points, cameras)[0][0], atol=1e-3)
    assert (depth > 0).all()


def test_noise_and_wrong_faces_are_outvoted():
    cameras, points = arc(), face_points()
    faces = images_of(points, cameras, noise=0.5)
    random = np.random.default_rng(3)
    # A face in the background, another place in each view; one view sees it alone.
    for view in range(len(faces)):
        faces[view].insert(0, random.uniform(0, 480, (LANDMARKS, 2)))
    del faces[4][1]
    faces.append([])
    face = triangulate_face([*cameras, cameras[0]], faces)
    assert face.views.tolist() == [1, 1, 1, 1, -1, 1, 1, 1, 1, -1]
    error = np.linalg.norm(face.points - points, axis=1)
    # Half a pixel is 0.44 mm at 0.8 m; eight views over 80 degrees average it.
    assert np.median(error) < 4e-4
    # The estimated error matches the true error of the points to within a factor.
    assert 0.5 < np.median(face.spread) / np.sqrt(np.mean(error**2)) < 2.0
    assert 0.3 < face.error < 0.9


def test_landmarks_that_slip_in_some_views_are_reweighted():
    cameras, points = arc(), face_points()
    faces = images_of(points, cameras, noise=0.2)
    for view in (0, 1):
        faces[view][0][10] += 25.0
    face = triangulate_face(cameras, faces)
    assert np.linalg.norm(face.points[10] - points[10]) < 1.5e-3


@pytest.mark.filterwarnings("error")
def test_faces_of_one_point_or_of_none_do_not_agree():
    cameras = arc()
    nowhere, at_one_point = np.full((LANDMARKS, 2), np.nan), np.full((LANDMARKS, 2), 5.0)
    for face in (nowhere, at_one_point):
        with pytest.raises(InputError, match="expected a face in at least two"):
            triangulate_face(cameras, [[face] for _ in cameras])


@pytest.mark.filterwarnings("error")
def test_views_that_mark_other_points_are_left_out():
    cameras, points = arc(), face_points()
    faces = images_of(points, cameras)
    marked = np.array(INTERIOR)
    for view, found in enumerate(faces):
        found[0][np.setdiff1d(np.arange(LANDMARKS), marked[:40] if view < 8 else marked[-40:])] = np.nan
    face = triangulate_face(cameras, faces)
    assert face.views.tolist() == [0] * 8 + [-1] * (len(cameras) - 8)
    np.testing.assert_allclose(face.points[marked[:40]], points[marked[:40]], atol=1e-4)


def test_no_face_and_two_people_are_refused():
    cameras, points = arc(), face_points()
    with pytest.raises(InputError, match=r"expected a face in at least two .*\(--landmarks\) or, .*\(fit --head\)"):
        triangulate_face(cameras, [[] for _ in cameras])
    beside = points + np.array([0.25, 0.0, 0.0])
    pairs = zip(images_of(points, cameras), images_of(beside, cameras), strict=True)
    both = [[*first, *second] for first, second in pairs]
    with pytest.raises(InputError, match="expected one person, found two"):
        triangulate_face(cameras, both)


def test_one_person_before_two_groups_of_cameras_that_disagree_is_not_two():
    cameras, points = arc(), face_points()
    # The last four cameras are wrong together, as where a loop of photographs does not close: 12 mm at the face.
    moved = points + np.array([0.012, 0.0, 0.0])
    faces = images_of(points, cameras[:5]) + images_of(moved, cameras[5:])
    face = triangulate_face(cameras, faces)
    assert face.views.tolist() == [0] * 5 + [-1] * 4
    np.testing.assert_allclose(face.points, points, atol=1e-4)


def test_a_few_poor_detections_are_better_than_none():
    cameras, points = [arc()[k] for k in (2, 6)], face_points()
    faces = images_of(points, cameras)
    # All landmarks up in one view and down in the other, each by some 3% of the face, cannot be explained by any point.
    faces[0][0][:, 1] += 4.0
    faces[1][0][:, 1] -= 4.0
    face = triangulate_face(cameras, faces)
    assert face.views.tolist() == [0, 0]
    assert np.median(np.linalg.norm(face.points - points, axis=1)) < 0.01
    faces[0][0][:, 1] += 12.0
    with pytest.raises(InputError, match="expected a face in at least two"):
        triangulate_face(cameras, faces)


def test_people_who_never_share_a_photograph_are_two():
    cameras, points = arc(), face_points()
    beside = points + np.array([0.25, 0.0, 0.0])
    faces = images_of(points, cameras[:5]) + images_of(beside, cameras[5:])
    with pytest.raises(InputError, match="one in 5 photographs, another in 4"):
        triangulate_face(cameras, faces)
