"""Notices on a page: progress, and errors in one sentence."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from neural_strands.foundation.errors import InputError, reason

if TYPE_CHECKING:
    import viser

log = logging.getLogger(__name__)

Say = Callable[[str], None]
"""Shows the progress of a task."""
SHOWN_SECONDS = 20.0
"""Time for which an error stays on the page, seconds."""


@contextmanager
def reporting(client: "viser.ClientHandle | None", doing: str) -> "Iterator[Say]":
    """Show on a browser's page that a task is running and, if it fails, why.

    Args:
        client: the browser; None if it has disconnected, then nothing is shown.
        doing: description of the task, such as "Cutting the hair".

    Yields:
        A function that shows the progress.
    """
    notice = None if client is None else client.add_notification(doing, "", loading=True, with_close_button=False)

    def say(sentence: str) -> None:
        if notice is not None:
            notice.body = sentence

    try:
        yield say
    except Exception as error:
        if not isinstance(error, InputError):
            log.exception("%s failed", doing)
        complain(client, error)
    finally:
        if notice is not None:
            notice.remove()


def complain(client: "viser.ClientHandle | None", error: Exception) -> None:
    """Show an error on a browser's page."""
    if client is None:
        return
    sentence = (
        str(error)
        if isinstance(error, InputError)
        else f"Unexpected error: {reason(error)}. The terminal in which the viewer runs shows more."
    )
    client.add_notification("That did not work", sentence, color="red", auto_close_seconds=SHOWN_SECONDS)
