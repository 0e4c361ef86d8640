"""Checks of the head: can it be read, and does it lie where the masks see hair and person?"""

from collections.abc import Sequence
from pathlib import Path

import torch
from jaxtyping import Int64
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.capture.check_images import EMPTY_MASK, ImageFacts
from neural_strands.capture.findings import Finding
from neural_strands.capture.head import head_path
from neural_strands.capture.head_agreement import HeadAgreement, head_agreement
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.head_file import SCALP_NAME, read_head_file
from neural_strands.scalp.load import find_scalp

COMPARED_VIEWS = 12
"""Largest number of views in which head and masks are compared, spread evenly over the capture."""
LIKELY_SCALP, LEAST_SCALP = 0.98, 0.6
"""Shares of the visible scalp inside hair masks below which a head is doubtful, or wrong. True heads of path-traced
captures reach 0.99; those shifted by 6 cm 0.80 to 0.97, and those 1.3 times too large 0.94 to 0.97."""
LIKELY_SKIN, MOST_SKIN = 0.85, 0.99
"""Shares of the other visible skin inside hair masks above which a head or its masks are doubtful, or wrong. True heads
reach 0.5 to 0.71 with hair that falls over the face, heads turned backwards 0.90 to 0.97, and masks of the whole person
passed as hair masks 1."""
LIKELY_HEAD, LEAST_HEAD = 0.95, 0.6
"""Shares of the visible head inside person masks below which a head is doubtful, or wrong. Heads shifted by 6 cm or 1.3
times too large reach 0.82 to 0.95."""


def check_head(capture: Capture, given: Path | None) -> tuple[Mesh | None, Int64[Tensor, " scalp"] | None, Finding]:
    """Read the given head, or else the capture's own.

    Args:
        capture: the capture.
        given: head mesh that replaces the capture's own, if any.

    Returns:
        The mesh in the file's unit, its scalp, and the finding; None and None if a fit would find no head.
    """
    path = head_path(capture.folder, given)
    if path is None:
        action = (
            "fit one with `neural-strands fit-head`, put one there as head.obj, or name it with --head when you "
            "check and when you fit"
        )
        return None, None, Finding("head", "error", "no head mesh", action)
    try:
        file = read_head_file(path)
        scalp = find_scalp(file)
    except InputError as error:
        action = "fix the file or name another with --head"
        return None, None, Finding("head", "error", str(error).rstrip("."), action)
    # Computed in the file's unit; `check_scale` checks the unit.
    area = 1e4 * float(face_areas(file.mesh)[scalp].sum())
    text = f"{path.name}, {len(file.mesh.faces)} triangles, {area:.0f} cm² of scalp"
    if file.scalp is None:
        text = f"{text} found from the shape because there is no {SCALP_NAME}"
        return file.mesh, scalp, Finding("head", "note", text, "name the faces hair grows from if that is not right")
    return file.mesh, scalp, Finding("head", "good", text)


def check_agreement(
    capture: Capture, facts: Sequence[ImageFacts], head: Mesh, scalp: Int64[Tensor, " scalp"]
) -> Finding | None:
    """Check that the head lies where the masks show hair and person; None if no mask can decide that."""
    usable = [index for index, fact in enumerate(facts) if _usable(fact)]
    if not usable:
        return None
    count = min(COMPARED_VIEWS, len(usable))
    places = torch.linspace(0, len(usable) - 1, count).round().int().tolist()
    views = capture.subset([usable[place] for place in places]).views_on()
    return judge_agreement(head_agreement(head, scalp, views))


def judge_agreement(agreement: HeadAgreement) -> Finding | None:
    """Turn an agreement into a finding; None if no view sees the head."""
    scalp, skin, head = agreement.scalp_in_hair, agreement.skin_in_hair, agreement.head_in_person
    place = "check that head and cameras share one frame (y up, +z out of the face, metres)"
    problems: list[tuple[bool, str, str]] = []
    if scalp is not None and scalp < LIKELY_SCALP:
        text = f"{100 * scalp:.0f} % of the visible scalp lies in the hair masks, expected nearly all of it"
        problems.append((scalp < LEAST_SCALP, text, f"{place}, and that masks are white where hair is"))
    if head is not None and head < LIKELY_HEAD:
        text = f"{100 * head:.0f} % of the visible head lies in the person masks, expected nearly all of it"
        problems.append((head < LEAST_HEAD, text, f"{place}, and that masks are white where the person is"))
    if skin is not None and skin > LIKELY_SKIN:
        text = f"{100 * skin:.0f} % of the face and the skin around it lies in the hair masks"
        action = f"give masks of the hair alone, not of the person, and {place}"
        problems.append((skin > MOST_SKIN, text, action))
    if problems:
        plain, text, action = max(problems, key=lambda problem: problem[0])
        return Finding("head and masks", "error" if plain else "warning", text, action)
    shares = [] if scalp is None else [f"{100 * scalp:.0f} % of the visible scalp lies in the hair masks"]
    shares += [] if head is None else [f"{100 * head:.0f} % of the visible head in the person masks"]
    return Finding("head and masks", "good", ", ".join(shares)) if shares else None


def _usable(fact: ImageFacts) -> bool:
    """Whether a view's masks show where hair or person is; empty masks are reported by `check_masks`."""
    empty = any(share is not None and share < EMPTY_MASK for share in (fact.hair, fact.person))
    return not fact.problem and not empty and (fact.hair is not None or fact.person is not None)
