"""The error that users see, and helpers that quote what was found."""

import reprlib

LONGEST_EXCERPT = 80
"""Largest number of characters of a file's content that a message quotes."""
LONGEST_REASON = 160
"""Largest number of characters of another library's error that a message repeats."""


class InputError(Exception):
    """Bad input: one sentence that names the file, what was expected, what was found, and what to do.

    The command line prints the sentence without a traceback and exits with status 2.

    Examples:
        >>> import neural_strands as ns
        >>> try:
        ...     ns.load_capture("nowhere")
        ... except ns.InputError as error:
        ...     print(error)
        nowhere: expected a capture folder, found nothing.
    """


class _Short(reprlib.Repr):
    """Python's notation of a value, cut before it is built, so that even a large value costs nothing to quote."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = LONGEST_EXCERPT
        self.maxlevel, self.maxlist, self.maxdict = 2, 4, 2


def excerpt(content: object) -> str:
    """Quote the content of a file as one short line of printable characters."""
    if isinstance(content, str | bytes):
        content = content[: LONGEST_EXCERPT + 1]
    return _cut(_Short().repr(content), LONGEST_EXCERPT)


def reason(error: BaseException) -> str:
    """Quote an error as one short line of printable characters, or its class name if it has no message."""
    said = (error.strerror if isinstance(error, OSError) else None) or str(error)
    line = " ".join(said[: 10 * LONGEST_REASON].split())
    printable = "".join(letter if letter.isprintable() else "?" for letter in line)
    return _cut(printable or type(error).__name__, LONGEST_REASON)


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 3] + "..."
