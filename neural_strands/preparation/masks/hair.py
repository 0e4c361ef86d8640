"""Masks of the hair without any model of hair: the placed head, the person's outline, colour and texture.

A pixel is hair, the rest of the person, or background. The head says where hair is likely (`zones.py`); the look of
hair is one histogram over all views, begun on the scalp above the forehead and beside the head; those of skin, clothes
and background are each view's own. A random walk draws the border along edges. Then the views vote on each point of the
head's surface, so that all agree on the hairline, looks are learned again from what was found, and it is done again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.pictures.looks import LookHistogram, look_cells
from neural_strands.preparation.masks.finish import finish_mask
from neural_strands.preparation.masks.random_walk import random_walk
from neural_strands.preparation.masks.zones import ZonedHead, Zones, votes
from neural_strands.preparation.photographs.folder import read_picture

LONGEST_SIDE = 1024
"""Pixels at which masks are computed; larger pictures get theirs enlarged."""
ROUNDS = 2
STRENGTH = 0.15
"""Of the evidence against a link of the random walk."""
SURE = 0.9
"""Probability from which a pixel teaches a look."""
PERSON_RANGE = (0.02, 0.98)
"""How sure the person's outline may be: it comes from a coarse network."""
VOTE_RANGE = (0.02, 0.98)
DOUBT = 0.1
"""Weight with which a pixel teaches the look of skin or clothes though that of hair explains it better."""
FRONTAL = 0.7
"""Cosine to the front from which a view shows the face: from the side hair hangs before it."""
WISPS, WISP_WEIGHT = 0.012, 0.6
"""Metres about the person's outline in which hair may stick out of it, and how likely the person is there."""
FEWEST_VOTES = 2
NO_OUTLINE = 0.06
"""Metres about the head that may be the person's where no outline is known."""


@dataclass(frozen=True)
class HairMasks:
    """Masks of every view.

    Attributes:
        coverage: for each view (height, width) of hair, 8 bits.
        vote: (vertex,) share of the views that show a vertex of the head and see hair before it; NaN where none does.
    """

    coverage: tuple[np.ndarray, ...]
    vote: np.ndarray


@dataclass(frozen=True)
class _Seen:
    """What a view says that does not change.

    Attributes:
        picture: 8-bit RGB.
        cells: of colour and texture.
        zones: what the head says of its pixels.
        person: (height, width) probability of the person.
        frontal: whether the face is seen from the front.
    """

    picture: np.ndarray
    cells: np.ndarray
    zones: Zones
    person: np.ndarray
    frontal: bool


def find_hair(
    cameras: Sequence[Camera],
    pictures: Sequence[Path],
    head: ZonedHead,
    outlines: Sequence[Path | None],
) -> HairMasks:
    """Find the hair of every view.

    Args:
        cameras: in world metres.
        pictures: undistorted.
        head: the placed template with its zones.
        outlines: for each view a mask of the person, if there is one.
    """
    scale = [min(1.0, LONGEST_SIDE / max(camera.width, camera.height)) for camera in cameras]
    small = [
        camera.resized(max(1, round(camera.width * k)), max(1, round(camera.height * k)))
        for camera, k in zip(cameras, scale, strict=True)
    ]
    seen = [
        _look(camera, picture, head, outline)
        for camera, picture, outline in track(
            list(zip(small, pictures, outlines, strict=True)), "looking at the person"
        )
    ]
    found = [np.where(view.zones.face, 0.0, _first_guess(view)) for view in seen]
    prior: torch.Tensor | None = None
    vote = np.zeros(0)
    for number in range(ROUNDS):
        frontal = [view for view in seen if view.frontal] or seen
        skin = LookHistogram.of([view.cells[view.zones.face] for view in frontal])
        hair = _hair_look(seen, found, skin)
        found = [
            _segment(view, guess, (hair, skin), head, camera, prior)
            for view, guess, camera in track(
                list(zip(seen, found, small, strict=True)), f"finding hair, round {number + 1} of {ROUNDS}"
            )
        ]
        mean, count = votes([view.zones for view in seen], found)
        vote = np.where(count >= FEWEST_VOTES, mean, np.nan)
        known = torch.from_numpy(np.clip(np.nan_to_num(vote), *VOTE_RANGE)).to(head.prior)
        # The face stays face: beards and brows have the colour of hair.
        replaced = torch.from_numpy(np.isfinite(vote)) & ~head.on_face
        prior = torch.where(replaced, torch.sqrt(known * head.prior), head.prior)
    coverage = tuple(
        finish_mask(
            guess,
            view.zones.prior * view.person,
            view.zones.below_chin,
            camera.footprint(_distance(camera, head)),
            (full.width, full.height),
        )
        for guess, view, camera, full in zip(found, seen, small, cameras, strict=True)
    )
    return HairMasks(coverage, vote)


def vote_on(cameras: Sequence[Camera], head: ZonedHead, coverage: Sequence[np.ndarray]) -> HairMasks:
    """Masks that are given, and what they say of the head's surface."""
    vote, count = votes([head.seen_by(camera) for camera in cameras], [mask / 255.0 for mask in coverage])
    return HairMasks(tuple(coverage), np.where(count >= FEWEST_VOTES, vote, np.nan))


def _look(camera: Camera, path: Path, head: ZonedHead, outline: Path | None) -> _Seen:
    size = (camera.width, camera.height)
    picture = cv2.resize(read_picture(path), size, interpolation=cv2.INTER_AREA)
    zones = head.seen_by(camera)
    if outline is not None:
        person = cv2.resize(read_picture(outline)[..., 0], size, interpolation=cv2.INTER_LINEAR) / np.float32(255)
        wide = 2 * round(WISPS / camera.footprint(_distance(camera, head))) + 1
        beside = cv2.dilate(person, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide)))
        person = np.maximum(person, WISP_WEIGHT * beside)
    else:
        reach = NO_OUTLINE / camera.footprint(_distance(camera, head))
        gap = cv2.distanceTransform((~(zones.head | zones.scalp)).astype(np.uint8), cv2.DIST_L2, 5)
        person = 1.0 / (1.0 + np.exp(np.clip((gap - reach) / (0.3 * reach), -30, 30)))
    towards = torch.nn.functional.normalize(camera.position - head.head.scalp_mesh.corners().mean(dim=(0, 1)), dim=0)
    person = np.clip(person, *PERSON_RANGE).astype(np.float32)
    return _Seen(picture, look_cells(picture), zones, person, float(towards[2]) > FRONTAL)


def _distance(camera: Camera, head: ZonedHead) -> float:
    """From the camera to the scalp, metres."""
    return float((head.head.scalp_mesh.corners().mean(dim=(0, 1)) - camera.position).norm())


def _first_guess(view: _Seen) -> np.ndarray:
    """Where hair is before its look is known: on the scalp's inside, and the person beside the head."""
    return view.zones.prior * view.person


def _hair_look(seen: Sequence[_Seen], found: Sequence[np.ndarray], skin: LookHistogram) -> LookHistogram:
    """The look of what is surely hair, twice: the second time without the pixels that skin explains better."""
    sure = [view.cells[guess > SURE] for view, guess in zip(seen, found, strict=True)]
    hair = LookHistogram.of(sure)
    return LookHistogram.of([cells[hair(cells) > skin(cells)] for cells in sure])


def _segment(
    view: _Seen,
    guess: np.ndarray,
    looks: tuple[LookHistogram, LookHistogram],
    head: ZonedHead,
    camera: Camera,
    prior: torch.Tensor | None,
) -> np.ndarray:
    """Evidence of each pixel from zone, outline and look, then the random walk."""
    zones = view.zones if prior is None else head.seen_by(camera, prior)
    is_person = view.person > 0.5
    hair, all_skin = looks
    trust = np.where(hair(view.cells) > all_skin(view.cells), DOUBT, 1.0)
    own_skin = LookHistogram.of([view.cells[zones.face]], [trust[zones.face]]) if view.frontal else all_skin
    others = is_person & (guess < 0.5) & ~zones.face
    rest = LookHistogram.of([view.cells[others]], [trust[others]])
    background = LookHistogram.of([view.cells[view.person < 0.1]])
    of_hair = view.person * zones.prior * hair(view.cells)
    of_person = (
        view.person
        * (1.0 - zones.prior)
        * (0.25 * (own_skin(view.cells) + all_skin(view.cells)) + 0.5 * rest(view.cells))
    )
    of_background = (1.0 - view.person) * background(view.cells)
    evidence = of_hair / (of_hair + of_person + of_background + 1e-12)
    return random_walk(view.picture, evidence, STRENGTH)
