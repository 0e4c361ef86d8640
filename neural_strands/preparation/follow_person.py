"""Follows a person who moves between photographs: cameras relative to the head, and where the torso was."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float64, UInt8

from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.geometry.cameras import Camera, TorsoMotion
from neural_strands.preparation.cameras.calibration import Calibration, SparsePoints
from neural_strands.preparation.cameras.motion import Expected, Motion, Tracks, find_motion
from neural_strands.preparation.cameras.register import read_model
from neural_strands.preparation.cameras.tracks import person_tracks
from neural_strands.preparation.face.topology import INTERIOR, NAMED
from neural_strands.preparation.face.triangulate import triangulate_face
from neural_strands.preparation.head.place import place
from neural_strands.preparation.head.template import Template
from neural_strands.preparation.photographs.folder import read_mask
from neural_strands.preparation.stage import ADVICE

FILE, TORSO_FILE = "motion.npz", "torso.npz"
HEAD_TURN, HEAD_SHIFT = np.radians(0.3), 0.001
"""Expected turn of the head about its middle, radians, and shift, metres, in a photograph."""
TORSO_TURN, TORSO_SHIFT = np.radians(1.0), 0.003
"""The same of the torso, relative to the head."""
BEHIND, RADIUS = 0.08, 0.22
"""Distance of the head's middle behind the face, and of points on the head from it at most, metres."""
BELOW = 0.03
"""Depth below the chin to which points belong to the head, metres."""
NECK = 0.06
"""Depth below the chin from which on the body moves with the torso, metres."""
ASIDE, DEEP = 0.45, 0.45
"""Distance of points on the torso from the neck's axis, to each side and to front and back, and depth below the neck,
metres."""
PERSON_SURE = 127
"""Value of a person mask (of 255) above which features count as the person's."""
FEWEST, PER_VIEW = 100, 20
"""Fewest points of a head or a torso that tell its motion, and fewest sightings of them in a photograph on average."""


@dataclass(frozen=True)
class PersonMotion:
    """How a person moved.

    Attributes:
        head: where the head was in each photograph, and the points on it.
        colour: of these points, sRGB in [0, 255].
        torso: where the torso was relative to the head, in the cameras' frame; None if photographs do not tell.
    """

    head: Motion
    colour: UInt8[np.ndarray, "point 3"]
    torso: tuple[TorsoMotion, ...] | None = None

    @property
    def points(self) -> SparsePoints:
        """The points on the head."""
        return SparsePoints(self.head.position, self.colour)

    def followed(self, calibration: Calibration) -> Calibration:
        """The cameras relative to the head, with its points alone, and with the motion of the torso."""
        cameras = self.head.followed(calibration.cameras)
        if self.torso is not None:
            cameras = tuple(replace(camera, torso=torso) for camera, torso in zip(cameras, self.torso, strict=True))
        return replace(calibration, cameras=cameras, points=self.points)

    def save(self, folder: Path) -> None:
        """Write `motion.npz` and `points.npz`, and `torso.npz` if the torso's motion is known."""
        np.savez(folder / FILE, turn=self.head.turn, shift=self.head.shift, middle=self.head.middle)
        self.points.save(folder)
        if self.torso is not None:
            motion = torch.stack([torso.motion for torso in self.torso])
            np.savez(folder / TORSO_FILE, motion=motion.numpy(), neck=self.torso[0].neck.numpy())

    @classmethod
    def load(cls, folder: Path, cameras: int) -> "PersonMotion | None":
        """Read what `save` wrote for so many cameras; None if photographs did not tell how the head moved.

        Raises:
            InputError: a file is damaged.
        """
        if not (folder / FILE).is_file():
            return None
        specs = (ArraySpec("turn", f"{cameras} 3"), ArraySpec("shift", f"{cameras} 3"), ArraySpec("middle", "3"))
        arrays = read_npz(folder / FILE, "the motion of a head", specs, ADVICE)
        points = SparsePoints.load(folder)
        torso = None
        if (folder / TORSO_FILE).is_file():
            specs = (ArraySpec("motion", f"{cameras} 4 4"), ArraySpec("neck", "2 3"))
            written = read_npz(folder / TORSO_FILE, "the motion of a torso", specs, ADVICE)
            motion, neck = (torch.from_numpy(written[name]).float() for name in ("motion", "neck"))
            torso = tuple(TorsoMotion(each, neck) for each in motion)
        return cls(Motion(arrays["turn"], arrays["shift"], points.position, arrays["middle"]), points.colour, torso)


def follow_person(
    model: Path,
    calibration: Calibration,
    faces: Sequence[Sequence[np.ndarray]],
    people: Sequence[Path | None],
    template: Template,
    say: Callable[[str], None],
) -> PersonMotion | None:
    """Find how the head and the torso moved; None if photographs show too few points on the head.

    Args:
        model: folder of COLMAP's model, in the cameras' frame.
        calibration: its cameras and undistorted pictures.
        faces: detected faces of each view.
        people: a mask of the person for each view, if there is one; the torso needs all.
        template: a head with landmarks, which tells where the head is and how large.
        say: receives messages for the user.

    Raises:
        InputError: the views do not agree on one face, or too few landmarks are known.
    """
    face = triangulate_face(calibration.cameras, faces)
    to_template = place(template, face).fit.inverse()
    marks = template.landmarks.double()
    inside = marks[list(INTERIOR)]
    centre = inside[torch.isfinite(inside).all(dim=1)].mean(dim=0) - torch.tensor([0.0, 0.0, BEHIND])
    chin = torch.nan_to_num(marks[NAMED["chin"], 1], nan=float(centre[1]) - RADIUS)

    def on_head(position: Float64[np.ndarray, "point 3"]) -> Bool[np.ndarray, " point"]:
        on_template = to_template.apply(torch.from_numpy(position))
        return (((on_template - centre).norm(dim=1) < RADIUS) & (on_template[:, 1] > chin - BELOW)).numpy()

    def on_torso(position: Float64[np.ndarray, "point 3"]) -> Bool[np.ndarray, " point"]:
        aside, below, ahead = (to_template.apply(torch.from_numpy(position)) - centre).T
        below = chin - NECK - centre[1] - below
        return ((aside.abs() < ASIDE) & (ahead.abs() < ASIDE) & (below > 0) & (below < DEEP)).numpy()

    def person(number: int) -> Bool[np.ndarray, "height width"] | None:
        camera, file = calibration.cameras[number], people[number]
        return None if file is None else read_mask(file, (camera.width, camera.height)) > PERSON_SURE

    found = read_model(model)
    tracks, colour = person_tracks(found, calibration.cameras, person, on_head)
    if not _enough(tracks, calibration.cameras):
        return None
    back = to_template.inverse()
    metres_per_unit = float(to_template.scale)
    expected = Expected(HEAD_TURN, HEAD_SHIFT / metres_per_unit)
    head = find_motion(calibration.cameras, tracks, back.apply(centre[None])[0].numpy(), expected)
    say(f"The head moved by {_size(head, metres_per_unit)} between photographs; cameras follow it.")
    if any(file is None for file in people):
        return PersonMotion(head, colour)
    tracks, _ = person_tracks(found, calibration.cameras, person, on_torso)
    if not _enough(tracks, calibration.cameras):
        return PersonMotion(head, colour)
    expected = Expected(TORSO_TURN, TORSO_SHIFT / metres_per_unit)
    middle = np.median(tracks.position, axis=0)
    torso = find_motion(head.followed(calibration.cameras), tracks, middle, expected)
    say(f"The torso moved by {_size(torso, metres_per_unit)} relative to the head.")
    axis = torch.stack([centre, centre])
    axis[:, 1] = chin - torch.tensor([0.0, NECK])
    neck = back.apply(axis).float()
    return PersonMotion(head, colour, tuple(TorsoMotion(motion.float(), neck) for motion in torso.transforms()))


def _enough(tracks: Tracks, cameras: Sequence[Camera]) -> bool:
    return len(tracks.position) >= FEWEST and len(tracks.camera) >= PER_VIEW * len(cameras)


def _size(motion: Motion, metres_per_unit: float) -> str:
    turn, shift = motion.size()
    return f"{1000 * metres_per_unit * shift:.1f} mm and {turn:.1f}°"
