"""What a page tells its readers: errors in one sentence, and that something is being done."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from neural_strands.foundation.errors import InputError, reason

if TYPE_CHECKING:
    import viser

log = logging.getLogger(__name__)

Say = Callable[[str], None]
"""Shows how far something is."""
SHOWN_SECONDS = 20.0
"""How long an error stays on the page."""


@contextmanager
def reporting(client: "viser.ClientHandle | None", doing: str) -> "Iterator[Say]":
    """Show on a browser's page that something is being done, and, where it fails, why.

    Args:
        client: the browser; None where it has left: then nothing is shown.
        doing: what is being done: "Cutting the hair".

    Yields:
        a function that shows how far it is.
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
    sentence = str(error) if isinstance(error, InputError) else f"Unexpected: {reason(error)}; the log says more."
    client.add_notification("That did not work", sentence, color="red", auto_close_seconds=SHOWN_SECONDS)
