"""Cameras follow a head that moved while COLMAP took everything for still."""

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.cameras.calibration import Calibration, SparsePoints
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.follow_head import BELOW, HeadMotion, follow_head
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.template import Template
from neural_strands.scalp.fit_similarity import Similarity

if TYPE_CHECKING:
    import pycolmap

pycolmap_found = pytest.importorskip("pycolmap")

UNIT = 0.1
"""Metres per unit of COLMAP's frame, in which its synthetic points fill a cube of two units."""


class Scene:
    """COLMAP's synthetic photographs of points about the template's head, which turned and shifted in each."""

    def __init__(self, folder: Path, moved: bool) -> None:
        options = pycolmap_found.SyntheticDatasetOptions()
        options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 16
        options.num_points3D = 400
        pycolmap_found.set_random_seed(0)
        self.model: pycolmap.Reconstruction = pycolmap_found.synthesize_dataset(options)
        self.template = builtin_template()
        self.frame = Similarity(1 / UNIT, torch.eye(3).double(), torch.tensor([0.0, 0.2, 0.3]).double())
        random = np.random.default_rng(0)
        self.cameras: list[Camera] = []
        self.faces: list[list[np.ndarray]] = []
        matrix = torch.tensor([[1280.0, 0, 512], [0, 1280, 384], [0, 0, 1]])
        marks = self.frame.apply(self.template.landmarks.double()).float()
        for image in sorted(self.model.images.values(), key=lambda image: image.name):
            pose = np.eye(4)
            pose[:3] = image.cam_from_world().matrix()
            seen = Camera(matrix, torch.from_numpy(pose).float(), 1024, 768, image.name)
            self.faces.append([seen.project(marks)[0].numpy()])
            motion = np.eye(4)
            if moved:
                motion[:3, :3] = Rotation.from_rotvec(np.radians(random.normal(0, 0.3, 3))).as_matrix()
                motion[:3, 3] = random.normal(0, 0.001 / UNIT, 3)
            room = pose @ np.linalg.inv(motion)
            image.frame.set_cam_from_world(image.camera_id, pycolmap_found.Rigid3d(room[:3]))
            self.cameras.append(Camera(matrix, torch.from_numpy(room).float(), 1024, 768, image.name))
        self.folder = folder / "model"
        self.folder.mkdir()
        self.model.write(self.folder)
        self.calibration = Calibration(tuple(self.cameras), (), SparsePoints.none())

    def follow(self, people: list[Path | None] | None = None, template: Template | None = None) -> HeadMotion | None:
        self.said: list[str] = []
        masks = [None] * len(self.cameras) if people is None else people
        chosen = self.template if template is None else template
        return follow_head(self.folder, self.calibration, self.faces, masks, chosen, self.said.append)

    def error(self, cameras: tuple[Camera, ...] | list[Camera], points: np.ndarray) -> float:
        """Median distance of points from where photographs show the nearest of the model's points, pixels."""
        images, errors = {image.name: image for image in self.model.images.values()}, []
        for camera in cameras:
            image = images[camera.name]
            shown = np.array([mark.xy for mark in image.points2D if mark.has_point3D()])
            plane = self.model.cameras[image.camera_id].cam_from_img(shown)
            pixel = np.asarray(plane) * 1280 + np.array([512, 384])
            found = camera.project(torch.from_numpy(points).float())[0].numpy()
            errors.append(np.linalg.norm(found[:, None] - pixel[None], axis=2).min(axis=1))
        return float(np.median(np.concatenate(errors)))


@pytest.fixture
def moving(tmp_path: Path) -> Scene:
    return Scene(tmp_path, moved=True)


def test_cameras_follow_the_head(moving: Scene, tmp_path: Path):
    found = moving.follow()
    assert found is not None
    assert moving.error(moving.cameras, found.points.position) > 1.0
    followed = found.followed(moving.calibration)
    assert moving.error(followed.cameras, found.points.position) < 0.1
    assert len(moving.said) == 1
    assert "cameras follow it" in moving.said[0]
    chin = float(moving.template.landmarks[NAMED["chin"], 1])
    heights = moving.frame.inverse().apply(torch.from_numpy(found.points.position))[:, 1]
    assert chin - BELOW - 0.005 < float(heights.min()) < chin
    assert len(followed.points.colour) == len(followed.points.position) > 200


def test_it_comes_back_from_its_files(moving: Scene, tmp_path: Path):
    found = moving.follow()
    assert found is not None
    (tmp_path / "stage").mkdir()
    found.save(tmp_path / "stage")
    back = HeadMotion.load(tmp_path / "stage", len(moving.cameras))
    assert back is not None
    for one, other in zip(
        found.followed(moving.calibration).cameras, back.followed(moving.calibration).cameras, strict=True
    ):
        assert torch.equal(one.world_to_camera, other.world_to_camera)
    assert np.array_equal(back.points.position, found.points.position)


def test_points_off_the_person_do_not_count(moving: Scene, tmp_path: Path):
    """The masks call the left half of every picture background."""
    person = np.zeros((768, 1024), np.uint8)
    person[:, 512:] = 255
    files: list[Path | None] = []
    for number in range(len(moving.cameras)):
        files.append(tmp_path / f"{number}.png")
        cv2.imwrite(str(files[-1]), person)
    assert moving.follow(files) is None
    assert moving.said == []


def test_a_head_that_stands_still_stays(tmp_path: Path):
    scene = Scene(tmp_path, moved=False)
    found = scene.follow()
    assert found is not None
    for before, after in zip(scene.cameras, found.followed(scene.calibration).cameras, strict=True):
        assert torch.allclose(before.world_to_camera, after.world_to_camera, atol=2e-3)


def test_without_files_the_motion_is_unknown(tmp_path: Path):
    assert HeadMotion.load(tmp_path, 3) is None
