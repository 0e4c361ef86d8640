"""Refines a fitted head by everything that photographs with masks of hair and person show of it."""

from collections.abc import Callable
from dataclasses import replace

from neural_strands.geometry.views import Views
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.agreed_shoulders import agreed_shoulders
from neural_strands.preparation.head.refinement.bare_outline import to_bare_outline
from neural_strands.preparation.head.refinement.crown import raise_skull
from neural_strands.preparation.head.refinement.torso import with_torso
from neural_strands.preparation.head.template import Template

LONGEST_SIDE, MOST_VIEWS = 640, 40
"""Size, pixels, and number of the photographs that are used; they are kept in memory together."""


def refine(fitted: FittedHead, template: Template, views: Views, say: Callable[[str], None]) -> FittedHead:
    """Raise the skull to the hair, continue the bust downwards, and move skin and clothes to where pictures show them.

    Args:
        fitted: a head placed on the person; its faces keep their numbers.
        template: what it was made from.
        views: the photographs, with cameras in the head's world.
        say: receives messages for the user.
    """
    every = -(-len(views) // MOST_VIEWS)
    small = list(views.selected(range(0, len(views), every)).reduced(LONGEST_SIDE))
    chosen = replace(Views.in_memory(small), witnesses=views.witnesses)
    longer = with_torso(raise_skull(fitted, chosen, say), template, chosen)
    return agreed_shoulders(to_bare_outline(longer, chosen, say), chosen, say)
