"""Follows a head that moves between photographs: cameras relative to it, from COLMAP's points on it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float64, UInt8

from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.preparation.cameras.calibration import Calibration, SparsePoints
from neural_strands.preparation.cameras.head_motion import Motion, find_motion
from neural_strands.preparation.cameras.head_tracks import head_tracks
from neural_strands.preparation.cameras.register import read_model
from neural_strands.preparation.face.topology import INTERIOR, NAMED
from neural_strands.preparation.face.triangulate import triangulate_face
from neural_strands.preparation.head.place import place
from neural_strands.preparation.head.template import Template
from neural_strands.preparation.photographs.folder import read_mask
from neural_strands.preparation.stage import ADVICE

FILE = "motion.npz"
BEHIND, RADIUS = 0.08, 0.22
"""Distance of the head's middle behind the face, and of points on the head from it at most, metres."""
BELOW = 0.03
"""Depth below the chin to which points belong to the head, metres."""
PERSON_SURE = 127
"""Value of a person mask (of 255) above which features count as the person's."""
FEWEST, PER_VIEW = 100, 20
"""Fewest points of the head that tell its motion, and fewest sightings of them in a photograph on average."""


@dataclass(frozen=True)
class HeadMotion:
    """How a head moved.

    Attributes:
        motion: where it was in each photograph, and the points on it.
        colour: of these points, sRGB in [0, 255].
    """

    motion: Motion
    colour: UInt8[np.ndarray, "point 3"]

    @property
    def points(self) -> SparsePoints:
        """The points on the head."""
        return SparsePoints(self.motion.position, self.colour)

    def followed(self, calibration: Calibration) -> Calibration:
        """The cameras relative to the head, with its points alone."""
        return replace(calibration, cameras=self.motion.followed(calibration.cameras), points=self.points)

    def save(self, folder: Path) -> None:
        """Write `motion.npz` and `points.npz`."""
        motion = self.motion
        np.savez(folder / FILE, turn=motion.turn, shift=motion.shift, middle=motion.middle)
        self.points.save(folder)

    @classmethod
    def load(cls, folder: Path, cameras: int) -> "HeadMotion | None":
        """Read what `save` wrote for so many cameras; None if photographs did not tell how the head moved.

        Raises:
            InputError: a file is damaged.
        """
        if not (folder / FILE).is_file():
            return None
        specs = (ArraySpec("turn", f"{cameras} 3"), ArraySpec("shift", f"{cameras} 3"), ArraySpec("middle", "3"))
        arrays = read_npz(folder / FILE, "the motion of a head", specs, ADVICE)
        points = SparsePoints.load(folder)
        return cls(Motion(arrays["turn"], arrays["shift"], points.position, arrays["middle"]), points.colour)


def follow_head(
    model: Path,
    calibration: Calibration,
    faces: Sequence[Sequence[np.ndarray]],
    people: Sequence[Path | None],
    template: Template,
    say: Callable[[str], None],
) -> HeadMotion | None:
    """Find how the head moved; None if photographs show too few points on it.

    Args:
        model: folder of COLMAP's model, in the cameras' frame.
        calibration: its cameras and undistorted pictures.
        faces: detected faces of each view.
        people: a mask of the person for each view, if there is one.
        template: a head with landmarks, which tells where the head is and how large.
        say: receives messages for the user.

    Raises:
        InputError: the views do not agree on one face, or too few landmarks are known.
    """
    face = triangulate_face(calibration.cameras, faces)
    to_head = place(template, face).fit.inverse()
    marks = template.landmarks.double()
    inside = marks[list(INTERIOR)]
    centre = inside[torch.isfinite(inside).all(dim=1)].mean(dim=0) - torch.tensor([0.0, 0.0, BEHIND])
    lowest = torch.nan_to_num(marks[NAMED["chin"], 1], nan=float(centre[1]) - RADIUS) - BELOW

    def on_head(position: Float64[np.ndarray, "point 3"]) -> Bool[np.ndarray, " point"]:
        on_template = to_head.apply(torch.from_numpy(position))
        return (((on_template - centre).norm(dim=1) < RADIUS) & (on_template[:, 1] > lowest)).numpy()

    def person(number: int) -> Bool[np.ndarray, "height width"] | None:
        camera, file = calibration.cameras[number], people[number]
        return None if file is None else read_mask(file, (camera.width, camera.height)) > PERSON_SURE

    tracks, colour = head_tracks(read_model(model), calibration.cameras, person, on_head)
    if len(tracks.position) < FEWEST or len(tracks.camera) < PER_VIEW * len(calibration.cameras):
        return None
    middle = to_head.inverse().apply(centre[None])[0].numpy()
    motion = find_motion(calibration.cameras, tracks, middle, float(to_head.scale))
    turn = np.degrees(np.sqrt((motion.turn**2).sum(axis=1).mean()))
    shift = 1000 * float(to_head.scale) * np.sqrt((motion.shift**2).sum(axis=1).mean())
    say(f"The head moved by {shift:.1f} mm and {turn:.1f}° between photographs; cameras follow it.")
    return HeadMotion(motion, colour)
