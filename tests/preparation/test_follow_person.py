"""Cameras follow a person who moved while COLMAP took everything for still."""

from dataclasses import replace
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
from neural_strands.preparation.follow_person import BELOW, NECK, PersonMotion, follow_person
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.template import Template
from neural_strands.scalp.fit_similarity import Similarity

if TYPE_CHECKING:
    import pycolmap

pycolmap_found = pytest.importorskip("pycolmap")

UNIT = 0.1
"""Metres per unit of COLMAP's frame, in which its synthetic points fill a cube of two units."""


def torso_motions(number: int) -> np.ndarray:
    """Rigid motions without a mean: where a torso lies that always moved in one way is arbitrary."""
    random, motion = np.random.default_rng(1), np.tile(np.eye(4), (number, 1, 1))
    turn, shift = random.normal(0, np.radians(0.5), (number, 3)), random.normal(0, 0.002 / UNIT, (number, 3))
    motion[:, :3, :3] = Rotation.from_rotvec(turn - turn.mean(axis=0)).as_matrix()
    motion[:, :3, 3] = shift - shift.mean(axis=0)
    return motion


class Scene:
    """COLMAP's synthetic photographs of points about the template's head, which turned and shifted in each.

    With `torso`, the head is higher up among the points, and those below its neck moved on their own.
    """

    def __init__(self, folder: Path, moved: bool, torso: bool = False) -> None:
        options = pycolmap_found.SyntheticDatasetOptions()
        options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 16
        options.num_points3D = 1500 if torso else 400
        pycolmap_found.set_random_seed(0)
        self.model: pycolmap.Reconstruction = pycolmap_found.synthesize_dataset(options)
        self.template = builtin_template()
        self.frame = Similarity(
            1 / UNIT, torch.eye(3).double(), torch.tensor([0.0, 1.3 if torso else 0.2, 0.3]).double()
        )
        random = np.random.default_rng(0)
        self.cameras: list[Camera] = []
        self.faces: list[list[np.ndarray]] = []
        self.torsos = torso_motions(len(self.model.images))
        self.poses: list[np.ndarray] = []
        matrix = torch.tensor([[1280.0, 0, 512], [0, 1280, 384], [0, 0, 1]])
        marks = self.frame.apply(self.template.landmarks.double()).float()
        for image in sorted(self.model.images.values(), key=lambda image: image.name):
            pose = np.eye(4)
            pose[:3] = image.cam_from_world().matrix()
            self.poses.append(pose)
            seen = Camera(matrix, torch.from_numpy(pose).float(), 1024, 768, image.name)
            self.faces.append([seen.project(marks)[0].numpy()])
            motion = np.eye(4)
            if moved:
                motion[:3, :3] = Rotation.from_rotvec(np.radians(random.normal(0, 0.3, 3))).as_matrix()
                motion[:3, 3] = random.normal(0, 0.001 / UNIT, 3)
            if torso:
                self._move_torso(image, pose, self.torsos[len(self.cameras)])
            room = pose @ np.linalg.inv(motion)
            image.frame.set_cam_from_world(image.camera_id, pycolmap_found.Rigid3d(room[:3]))
            self.cameras.append(Camera(matrix, torch.from_numpy(room).float(), 1024, 768, image.name))
        self.folder = folder / "model"
        self.folder.mkdir()
        self.model.write(self.folder)
        self.calibration = Calibration(tuple(self.cameras), (), SparsePoints.none())

    def _move_torso(self, image: "pycolmap.Image", pose: np.ndarray, motion: np.ndarray) -> None:
        """Show the points below the neck where they moved."""
        camera = self.model.cameras[image.camera_id]
        for mark in image.points2D:
            if mark.has_point3D() and self.model.points3D[mark.point3D_id].xyz[1] < self.collar():
                place = np.append(self.model.points3D[mark.point3D_id].xyz, 1.0)
                mark.xy = camera.img_from_cam((pose @ motion @ place)[None, :3])[0]

    def collar(self) -> float:
        """Height below which the torso moves, in COLMAP's frame."""
        chin = self.template.landmarks[NAMED["chin"]].double() - torch.tensor([0.0, NECK, 0.0])
        return float(self.frame.apply(chin[None])[0, 1])

    def everybody(self, folder: Path) -> list[Path | None]:
        """Masks of a person who fills all pictures."""
        cv2.imwrite(str(folder / "all.png"), np.full((768, 1024), 255, np.uint8))
        return [folder / "all.png"] * len(self.cameras)

    def follow(self, people: list[Path | None] | None = None, template: Template | None = None) -> PersonMotion | None:
        self.said: list[str] = []
        masks = [None] * len(self.cameras) if people is None else people
        chosen = self.template if template is None else template
        return follow_person(self.folder, self.calibration, self.faces, masks, chosen, self.said.append)

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


def test_the_torso_has_a_motion_of_its_own(tmp_path: Path):
    scene = Scene(tmp_path, moved=True, torso=True)
    found = scene.follow(scene.everybody(tmp_path))
    assert found is not None
    assert len(scene.said) == 2
    assert "relative to the head" in scene.said[1]
    below = np.stack([point.xyz for point in scene.model.points3D.values() if point.xyz[1] < scene.collar()])
    above = np.stack([point.xyz for point in scene.model.points3D.values() if point.xyz[1] > scene.collar() + 0.7])
    errors, without = [], []
    for camera, torso, pose in zip(found.followed(scene.calibration).cameras, scene.torsos, scene.poses, strict=True):
        assert camera.torso is not None
        assert torch.equal(camera.torso.moved(torch.from_numpy(above).float()), torch.from_numpy(above).float())
        truth = replace(camera, world_to_camera=torch.from_numpy(pose @ torso).float())
        true = truth.project(torch.from_numpy(below).float())[0]
        here = torch.from_numpy(below).float()
        errors.append((camera.project(camera.torso.moved(here))[0] - true).norm(dim=1))
        without.append((camera.project(here)[0] - true).norm(dim=1))
    assert float(torch.cat(without).median()) > 2.0
    assert float(torch.cat(errors).median()) < 0.25 * float(torch.cat(without).median())


def test_without_masks_the_torso_stays(tmp_path: Path):
    """Without them, the room would count as the torso."""
    scene = Scene(tmp_path, moved=True, torso=True)
    found = scene.follow()
    assert found is not None
    assert found.torso is None
    assert len(scene.said) == 1


@pytest.mark.parametrize("torso", [False, True])
def test_it_comes_back_from_its_files(torso: bool, tmp_path: Path):
    moving = Scene(tmp_path, moved=True, torso=torso)
    found = moving.follow(moving.everybody(tmp_path))
    assert found is not None
    (tmp_path / "stage").mkdir()
    found.save(tmp_path / "stage")
    back = PersonMotion.load(tmp_path / "stage", len(moving.cameras))
    assert back is not None
    for one, other in zip(
        found.followed(moving.calibration).cameras, back.followed(moving.calibration).cameras, strict=True
    ):
        assert torch.equal(one.world_to_camera, other.world_to_camera)
        assert (one.torso is not None) == (other.torso is not None) == torso
        if one.torso is not None and other.torso is not None:
            assert torch.equal(one.torso.motion, other.torso.motion)
            assert torch.equal(one.torso.neck, other.torso.neck)
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
    assert PersonMotion.load(tmp_path, 3) is None
