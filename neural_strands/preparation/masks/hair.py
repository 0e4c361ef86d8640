"""Masks of the hair without a learned model: from the placed head, the person's outline, colour and texture.

A pixel is hair, the rest of the person, or background. The head determines where hair is likely (`zones.py`). The look
of hair is one histogram over all views, initialised on the scalp above the forehead and beside the head; each view has
its own histograms of skin, clothes and background. A random walk aligns the border with edges. Then the views vote on
each point of the head's surface, so that they agree on the hairline, the histograms are learned again from the result,
and everything is repeated.
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
"""Longer side at which masks are computed, pixels; masks of larger pictures are enlarged."""
ROUNDS = 2
STRENGTH = 0.15
"""Weight of the evidence relative to a link of the random walk."""
SURE = 0.9
"""Probability above which a pixel contributes to a histogram."""
PERSON_RANGE = (0.02, 0.98)
"""Bounds of the probability from the person's outline, which comes from a coarse network."""
VOTE_RANGE = (0.02, 0.98)
DOUBT = 0.1
"""Weight in the histogram of skin or clothes of a pixel that the one of hair explains better."""
FRONTAL = 0.7
"""Least cosine to the front for a view to show the face: seen from the side, hair hangs in front of it."""
WISPS, WISP_WEIGHT = 0.012, 0.6
"""Distance by which hair may stick out of the person's outline, metres, and the probability of the person there."""
FEWEST_VOTES = 2
NO_OUTLINE = 0.06
"""Distance from the head that may belong to the person if there is no outline, metres."""


@dataclass(frozen=True)
class HairMasks:
    """Masks of every view.

    Attributes:
        coverage: hair mask of each view, (height, width), 8 bits.
        vote: (vertex,) share of the views of each vertex of the head that see hair in front of it; NaN if none sees the
            vertex.
    """

    coverage: tuple[np.ndarray, ...]
    vote: np.ndarray


@dataclass(frozen=True)
class _Seen:
    """The parts of a view that stay fixed over the rounds.

    Attributes:
        picture: 8-bit RGB.
        cells: histogram cells of colour and texture.
        zones: the head's zones in the view.
        person: (height, width) probability of the person.
        frontal: whether the view shows the face from the front.
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
    """Segment the hair in every view.

    Args:
        cameras: cameras of the views, world metres.
        pictures: the undistorted pictures.
        head: the placed template with its zones.
        outlines: a mask of the person for each view, if there is one.
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
        # The prior of the face is not replaced: beards and brows have the colour of hair.
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
    """Compute the votes on the head's surface for given masks."""
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
    """Distance from the camera to the scalp, metres."""
    return float((head.head.scalp_mesh.corners().mean(dim=(0, 1)) - camera.position).norm())


def _first_guess(view: _Seen) -> np.ndarray:
    """Probability of hair before its look is known: the scalp, and the person beside the head."""
    return view.zones.prior * view.person


def _hair_look(seen: Sequence[_Seen], found: Sequence[np.ndarray], skin: LookHistogram) -> LookHistogram:
    """Learn the look of pixels that are surely hair, then again without those that skin explains better."""
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
    """Combine zone, outline and look into evidence for each pixel, then run the random walk."""
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
