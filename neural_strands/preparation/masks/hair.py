"""Masks of the hair without a learned model: from the placed head, the person's outline, colour and texture.

A pixel is hair, the rest of the person, or background. The head determines where hair is likely (`zones.py`). The look
of hair is one histogram over all views, initialised on the scalp above the forehead and beside the head. The look of
clothes is another: that of everything below the chin, less the hair there. Each view has its own histograms of skin and
background. A random walk aligns the border with edges. Then the views vote on each point of the head's surface, so that
they agree on the hairline, the histograms are learned again from the result, and everything is repeated. In the end,
the views judge parts that are apart from the rest (`agreement.py`).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import torch

from neural_strands.capture.images import reduced
from neural_strands.foundation.image_files import image_size
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera
from neural_strands.pictures.looks import LookHistogram, look_cells
from neural_strands.preparation.masks.agreement import WITNESSES, Agreement
from neural_strands.preparation.masks.finish import Judge, parts_of_hair, soft_mask
from neural_strands.preparation.masks.random_walk import random_walk
from neural_strands.preparation.masks.zones import Ballot, Shown, ZonedHead
from neural_strands.preparation.photographs.folder import read_mask, read_picture

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
MOST_HAIR = 0.5
"""Largest share of what is below the chin that is taken for hair when the look of clothes is learned."""
FRONTAL = 0.7
"""Least cosine to the front for a view to show the face: seen from the side, hair hangs in front of it."""
CURTAIN = 0.2
"""Probability of hair in front of the face in views from the side."""
WISPS, WISP_WEIGHT = 0.012, 0.6
"""Distance by which hair may stick out of the person's outline, metres, and the probability of the person there."""
NO_OUTLINE = 0.06
"""Distance from the head that may belong to the person if there is no outline, metres."""


@dataclass(frozen=True)
class HairMasks:
    """Masks of every view.

    Attributes:
        coverage: hair mask of each view, (height, width), 8 bits; each is made when it is taken, because together they
            may not fit into memory.
        vote: (vertex,) share of the views of each vertex of the head that see hair in front of it; NaN if fewer than
            two show the vertex.
    """

    coverage: Iterator[np.ndarray]
    vote: np.ndarray


@dataclass(frozen=True)
class _Seen:
    """The parts of a view that stay fixed over the rounds. Those of all views are kept, so they are small.

    Attributes:
        picture: 8-bit RGB.
        cells: histogram cells of colour and texture.
        prior: (height, width) probability that a pixel of the person is hair, half precision.
        face: (height, width) the face below the brows.
        below_chin: (height, width) pixels that show something lower than the chin.
        person: (height, width) probability of the person, half precision.
        shown: the head's vertices that the view shows.
        frontal: whether the view shows the face from the front.
    """

    picture: np.ndarray
    cells: np.ndarray
    prior: np.ndarray
    face: np.ndarray
    below_chin: np.ndarray
    person: np.ndarray
    shown: Shown
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
    small = [camera.reduced(LONGEST_SIDE) for camera in cameras]
    seen = [
        _look(camera, picture, head, outline)
        for camera, picture, outline in track(
            list(zip(small, pictures, outlines, strict=True)), "looking at the person"
        )
    ]
    found = [np.where(view.face, np.float16(0), _first_guess(view)) for view in seen]
    prior: torch.Tensor | None = None
    vote = np.zeros(0)
    for number in range(ROUNDS):
        frontal = [view for view in seen if view.frontal] or seen
        skin = LookHistogram.of([view.cells[view.face] for view in frontal])
        hair = _hair_look(seen, found, skin)
        clothes = _clothes_look(seen, hair)
        found = [
            _segment(view, guess, (hair, skin, clothes), head, camera, prior)
            for view, guess, camera in track(
                list(zip(seen, found, small, strict=True)), f"finding hair, round {number + 1} of {ROUNDS}"
            )
        ]
        vote = _votes(head, (view.shown for view in seen), found)
        known = torch.from_numpy(np.clip(np.nan_to_num(vote), *VOTE_RANGE)).to(head.prior)
        # The prior of the face is not replaced: beards and brows have the colour of hair.
        replaced = torch.from_numpy(np.isfinite(vote)) & ~head.on_face
        prior = torch.where(replaced, torch.sqrt(known * head.prior), head.prior)

    def parts(number: int, agreed: Judge | None = None) -> np.ndarray:
        view, footprint = seen[number], _footprint(small[number], head)
        return parts_of_hair(found[number], view.prior * view.person, view.below_chin, footprint, agreed)

    numbers = range(len(cameras))
    judges: list[Judge | None] = [None for _ in numbers]
    if len(cameras) > WITNESSES:
        agreement = Agreement.of(small, map(parts, numbers), head.head.mesh)
        judges = [partial(agreement.shares, number) for number in numbers]
    coverage = (
        soft_mask(parts(number, judges[number]), (cameras[number].width, cameras[number].height)) for number in numbers
    )
    return HairMasks(coverage, vote)


def vote_on(cameras: Sequence[Camera], head: ZonedHead, masks: Iterable[np.ndarray]) -> np.ndarray:
    """Compute the votes on the head's surface for given masks.

    Args:
        cameras: cameras of the views, world metres.
        head: the placed template with its zones.
        masks: a mask of the hair for each camera, (height, width), 8 bits.

    Returns:
        The votes (vertex,), as in `HairMasks`.
    """
    shown = (head.seen_by(camera.reduced(LONGEST_SIDE)).shown for camera in cameras)
    return _votes(head, shown, (reduced(mask, LONGEST_SIDE) / np.float32(255) for mask in masks))


def _votes(head: ZonedHead, shown: Iterable[Shown], coverage: Iterable[np.ndarray]) -> np.ndarray:
    ballot = Ballot(len(head.head.mesh.vertices))
    for vertices, covered in zip(shown, coverage, strict=True):
        ballot.add(vertices, covered)
    return ballot.shares()


def _look(camera: Camera, path: Path, head: ZonedHead, outline: Path | None) -> _Seen:
    size = (camera.width, camera.height)
    picture = reduced(read_picture(path), LONGEST_SIDE)
    zones = head.seen_by(camera)
    if outline is not None:
        mask = read_mask(outline, image_size(path))
        person = cv2.resize(mask, size, interpolation=cv2.INTER_LINEAR) / np.float32(255)
        wide = 2 * round(WISPS / _footprint(camera, head)) + 1
        beside = cv2.dilate(person, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide)))
        person = np.maximum(person, WISP_WEIGHT * beside)
    else:
        reach = NO_OUTLINE / _footprint(camera, head)
        gap = cv2.distanceTransform((~(zones.head | zones.scalp)).astype(np.uint8), cv2.DIST_L2, 5)
        person = 1.0 / (1.0 + np.exp(np.clip((gap - reach) / (0.3 * reach), -30, 30)))
    towards = torch.nn.functional.normalize(camera.position - head.head.scalp_mesh.corners().mean(dim=(0, 1)), dim=0)
    return _Seen(
        picture,
        look_cells(picture),
        zones.prior.astype(np.float16),
        zones.face,
        zones.below_chin,
        np.clip(person, *PERSON_RANGE).astype(np.float16),
        zones.shown,
        float(towards[2]) > FRONTAL,
    )


def _footprint(camera: Camera, head: ZonedHead) -> float:
    """Width of a pixel at the scalp, metres."""
    return camera.footprint(float((head.head.scalp_mesh.corners().mean(dim=(0, 1)) - camera.position).norm()))


def _first_guess(view: _Seen) -> np.ndarray:
    """Probability of hair before its look is known: the scalp, and the person beside the head."""
    return view.prior * view.person


def _hair_look(seen: Sequence[_Seen], found: Sequence[np.ndarray], skin: LookHistogram) -> LookHistogram:
    """Learn the look of pixels that are surely hair, then again without those that skin explains better."""
    sure = [view.cells[guess > SURE] for view, guess in zip(seen, found, strict=True)]
    hair = LookHistogram.of(sure)
    return LookHistogram.of([cells[hair(cells) > skin(cells)] for cells in sure])


def _clothes_look(seen: Sequence[_Seen], hair: LookHistogram) -> LookHistogram:
    """Learn the look of what is below the chin, skin and clothes, without the hair that hangs there.

    Clothes may be as dark as the hair, so pixels that resemble hair cannot just be left out.
    """
    below = LookHistogram.of([view.cells[view.below_chin & (view.person > 0.5) & (view.prior < 0.5)] for view in seen])
    return below.without(hair, min(below.largest_share(hair), MOST_HAIR))


def _segment(
    view: _Seen,
    guess: np.ndarray,
    looks: tuple[LookHistogram, LookHistogram, LookHistogram],
    head: ZonedHead,
    camera: Camera,
    prior: torch.Tensor | None,
) -> np.ndarray:
    """Combine zone, outline and look into evidence for each pixel, then run the random walk."""
    likely = view.prior.astype(np.float32) if prior is None else head.seen_by(camera, prior).prior
    if not view.frontal:
        likely = np.where(view.face, np.maximum(likely, CURTAIN), likely)
    person = view.person.astype(np.float32)
    hair, all_skin, clothes = looks
    trust = np.where(hair(view.cells) > all_skin(view.cells), DOUBT, 1.0)
    own_skin = LookHistogram.of([view.cells[view.face]], [trust[view.face]]) if view.frontal else all_skin
    others = (person > 0.5) & (guess < 0.5) & ~view.face
    rest = LookHistogram.of([view.cells[others]], [trust[others]])
    background = LookHistogram.of([view.cells[person < 0.1]])
    of_hair = person * likely * hair(view.cells)
    other = np.where(view.below_chin, clothes(view.cells), rest(view.cells))
    of_person = person * (1.0 - likely) * (0.25 * (own_skin(view.cells) + all_skin(view.cells)) + 0.5 * other)
    of_background = (1.0 - person) * background(view.cells)
    evidence = of_hair / (of_hair + of_person + of_background + 1e-12)
    return random_walk(view.picture, evidence, STRENGTH).astype(np.float16)
