"""Checks of the photographs and their masks: readable, sharp, evenly exposed, not empty."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.findings import Finding
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.foundation.srgb import to_linear

BLURRED = 0.55
"""Share of an image's fine detail that survives a further blur of one pixel, above which it counts as blurred. Sharp
photographs keep 0.2 to 0.45; after a blur of 1.5 pixels they keep 0.53 to 0.68, after 2 pixels 0.65 to 0.77 (measured
on path-traced hair and real photographs)."""
DRIFT = 0.75
"""Photographic stops by which a view may differ from neighbouring views (hair under fixed lights varies by up to
0.6)."""
CLIPPED = 0.1
"""Share of the subject's pixels that may be burnt out without a warning."""
EMPTY_MASK = 0.001
"""A mask that covers less than this share of the image is empty."""
FULL_MASK = 0.98
"""A mask that covers more than this share of the image is useless."""


@dataclass(frozen=True)
class ImageFacts:
    """Facts about the files of one view.

    Attributes:
        name: name of the view.
        problem: why the image or a mask cannot be used, if it cannot.
        blur: share of fine detail that survives a further blur; NaN if there is no detail at all.
        exposure: mean linear brightness of the subject, stops (log2).
        clipped: share of the subject's pixels that are burnt out.
        hair: share of the image that the hair mask covers; None without a mask.
        person: share of the image that the person mask covers; None without a mask.
    """

    name: str
    problem: str = ""
    blur: float = float("nan")
    exposure: float = float("nan")
    clipped: float = 0.0
    hair: float | None = None
    person: float | None = None


def gather(capture: Capture) -> list[ImageFacts]:
    """Read every view once and gather its facts."""
    return [_facts(capture, index) for index in track(range(len(capture)), "looking at images")]


def check_files(facts: Sequence[ImageFacts]) -> list[Finding]:
    """Report missing, unreadable and wrongly sized files, one row per view."""
    broken = [fact for fact in facts if fact.problem]
    if not broken:
        return [Finding("files", "good", f"{len(facts)} images and their masks can be read and match their cameras")]
    return [Finding("files", "error", fact.problem, "fix the file or remove the view", ()) for fact in broken]


def check_masks(facts: Sequence[ImageFacts], kind: str) -> Finding:
    """Report absent, empty and full masks; `kind` is "hair" or "person"."""
    covered = {fact.name: getattr(fact, kind) for fact in facts if not fact.problem}
    missing = tuple(name for name, share in covered.items() if share is None)
    if len(missing) == len(covered):
        need = "without them, hair cannot be separated from the rest" if kind == "hair" else "optional"
        action = f"add {kind} masks in {'masks' if kind == 'hair' else 'person_masks'}/ (white where there is {kind})"
        return Finding(f"{kind} masks", "warning" if kind == "hair" else "note", f"none ({need})", action)
    if missing:
        return Finding(f"{kind} masks", "warning", f"missing for {len(missing)} views", "add them", missing)
    empty = tuple(name for name, share in covered.items() if share is not None and share < EMPTY_MASK)
    full = tuple(name for name, share in covered.items() if share is not None and share > FULL_MASK)
    if len(empty) == len(covered) and kind == "hair":
        action = "draw them again (white where there is hair), or remove masks/ to go without"
        return Finding("hair masks", "error", f"all {len(empty)} are empty", action)
    if empty:
        action = "draw them again, or remove views without hair"
        return Finding(f"{kind} masks", "warning", f"{len(empty)} of {len(covered)} are empty", action, empty)
    if full:
        action = "draw them again: white only where there is hair"
        return Finding(f"{kind} masks", "warning", f"{len(full)} of {len(covered)} cover the whole image", action, full)
    shares = [100 * share for share in covered.values() if share is not None]
    facts_text = f"{len(shares)} masks cover {min(shares):.0f} to {max(shares):.0f} % of their images"
    return Finding(f"{kind} masks", "good", facts_text)


def check_sharpness(facts: Sequence[ImageFacts]) -> Finding:
    """Report views without any detail, out of focus, or blurred by motion."""
    read = [fact for fact in facts if not fact.problem]
    known = [fact for fact in read if not math.isnan(fact.blur)]
    if not known:
        action = "check that the images are photographs: nothing can be reconstructed from black or uniform ones"
        return Finding("sharpness", "error", "no image has any detail", action)
    if len(known) < len(read):
        blank = tuple(fact.name for fact in read if math.isnan(fact.blur))
        text = f"{len(blank)} of {len(read)} have no detail where hair should be"
        return Finding("sharpness", "warning", text, "remove these views or export them again", blank)
    blurred = tuple(fact.name for fact in known if fact.blur > BLURRED)
    if blurred:
        action = "remove these views or take them again: hair is thinner than the blur"
        return Finding("sharpness", "warning", f"{len(blurred)} of {len(known)} are blurred", action, blurred)
    return Finding("sharpness", "good", "no view is blurred")


def check_exposure(capture: Capture, facts: Sequence[ImageFacts]) -> Finding:
    """Report views that are brighter or darker than their neighbours, or burnt out."""
    usable = [index for index, fact in enumerate(facts) if not fact.problem]
    if len(usable) < 4:
        return Finding("exposure", "note", "too few views to compare")
    axes = torch.stack([capture.cameras[index].rotation[2] for index in usable])
    stops = torch.tensor([facts[index].exposure for index in usable])
    alike = (axes @ axes.T).fill_diagonal_(-2.0)
    beside = alike.topk(3, dim=1).indices
    off = (stops - stops[beside].median(dim=1).values).abs()
    drifting = tuple(facts[usable[k]].name for k in range(len(usable)) if off[k] > DRIFT)
    if drifting:
        action = "fix exposure and white balance for the whole capture, or equalise them beforehand"
        text = f"{len(drifting)} of {len(usable)} views are {DRIFT} stops or more off their neighbours"
        return Finding("exposure", "warning", text, action, drifting)
    burnt = tuple(facts[index].name for index in usable if facts[index].clipped > CLIPPED)
    if burnt:
        text = f"in {len(burnt)} of {len(usable)} views more than {100 * CLIPPED:.0f} % of the subject is burnt out"
        return Finding("exposure", "warning", text, "expose less: highlights carry the hair's direction", burnt)
    return Finding("exposure", "good", f"neighbouring views differ by {float(off.max()):.2f} stops at most")


def _facts(capture: Capture, index: int) -> ImageFacts:
    name = capture.cameras[index].name
    try:
        image = capture.image(index).numpy()
        hair, person = capture.hair_mask(index), capture.person_mask(index)
    except InputError as error:
        return ImageFacts(name, problem=str(error).rstrip("."))
    subject = _subject(image, hair, person)
    linear = to_linear(torch.from_numpy(image[subject])).numpy()
    return ImageFacts(
        name,
        blur=_blur(image, subject),
        exposure=float(np.log2(max(float(linear.mean()), 1e-6))),
        clipped=float((image[subject].min(axis=-1) > 0.99).mean()),
        hair=None if hair is None else float(hair.mean()),
        person=None if person is None else float(person.mean()),
    )


def _subject(image: np.ndarray, hair: torch.Tensor | None, person: torch.Tensor | None) -> np.ndarray:
    """The region of the subject: the hair, or the person, or the middle half of the image."""
    for mask in (hair, person):
        if mask is not None and float((mask > 0.5).float().mean()) > EMPTY_MASK:
            return (mask > 0.5).numpy()
    height, width = image.shape[:2]
    middle = np.zeros((height, width), bool)
    middle[height // 4 : height - height // 4, width // 4 : width - width // 4] = True
    return middle


def _blur(image: np.ndarray, subject: np.ndarray) -> float:
    """Share of fine detail that survives another blur (after Crete et al. 2007).

    Ratio of the Laplacian's mean square after and before a Gaussian of one pixel: small for fine detail, near 1 for an
    image that was already blurred. A preceding Gaussian of one pixel removes noise and rounding.
    """
    grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), 1.0)
    fine = cv2.Laplacian(grey, cv2.CV_32F)[subject]
    coarse = cv2.Laplacian(cv2.GaussianBlur(grey, (0, 0), 1.0), cv2.CV_32F)[subject]
    energy = float(np.square(fine).mean())
    return float(np.square(coarse).mean()) / energy if energy > 1e-8 else float("nan")
