"""Reads numbers from lines of text quickly, and locates errors by line and byte."""

import re
import warnings
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import excerpt
from neural_strands.grooms.checks import refuse

IS_SPACE = np.zeros(256, dtype=bool)
"""Bytes that separate numbers: white space as the C library defines it."""
IS_SPACE[[9, 10, 11, 12, 13, 32]] = True
NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


class Lines:
    """The lines of a file and their words (runs of bytes that are not white space), found in one pass.

    Attributes:
        buffer: every byte of the file.
        start: first byte of each line.
        word: first byte of each word.
        word_count: words of each line.
        first_word: index into `word` of each line's first word.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self.data = data
        self.buffer = np.frombuffer(data, np.uint8)
        breaks = np.flatnonzero(self.buffer == 10)
        self.start = np.concatenate([[0], breaks + 1])
        dark = ~IS_SPACE[self.buffer]
        dark[1:] &= IS_SPACE[self.buffer[:-1]]
        self.word = np.flatnonzero(dark)
        bounds = np.searchsorted(self.word, np.append(self.start, len(data)))
        self.first_word = bounds[:-1]
        self.word_count = np.diff(bounds)

    def __len__(self) -> int:
        return len(self.start)

    def where(self, line: int, byte: int | None = None) -> str:
        """Describe the position of a line (counted from 0 here, from 1 for the user) or of a byte in it."""
        return f"line {line + 1} (byte {int(self.start[line]) if byte is None else byte})"

    def keyword(self, letter: bytes) -> np.ndarray:
        """Mark the lines whose first word is this letter."""
        found = np.zeros(len(self), dtype=bool)
        lines = np.flatnonzero(self.word_count > 0)
        begin = self.word[self.first_word[lines]]
        after = np.minimum(begin + 1, len(self.buffer) - 1)
        alone = IS_SPACE[self.buffer[after]] | (after == begin)
        found[lines] = (self.buffer[begin] == letter[0]) & alone
        return found

    def numbers(self, chosen: np.ndarray, skip_word: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Read every number of the chosen lines.

        Args:
            chosen: one boolean per line.
            skip_word: skip each line's first word, which is one letter.

        Returns:
            The numbers in double precision, and how many each chosen line has.

        Raises:
            InputError: a word is not a number.
        """
        counts = self.word_count[chosen] - int(skip_word)
        lengths = np.diff(np.append(self.start, len(self.data)))
        kept = np.where(np.repeat(chosen, lengths), self.buffer, np.uint8(32))
        if skip_word:
            kept[self.word[self.first_word[chosen]]] = 32
        if kept.min(initial=32) == 0:
            raise self._not_a_number(chosen, skip_word)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                values = np.fromstring(kept.tobytes(), dtype=np.float64, sep=" ")
            except (DeprecationWarning, ValueError):
                raise self._not_a_number(chosen, skip_word) from None
        total = int(counts.sum())
        if total == 0:
            return np.zeros(0), counts
        if len(values) != total:
            raise self._not_a_number(chosen, skip_word)
        return values, counts

    def _not_a_number(self, chosen: np.ndarray, skip_word: bool) -> Exception:
        """Build the error for the first word that is not a number, found by a slow search."""
        for line in np.flatnonzero(chosen).tolist():
            first = self.first_word[line] + int(skip_word)
            for byte in self.word[first : self.first_word[line] + self.word_count[line]].tolist():
                word = self.data[byte : byte + 40].split(None, 1)[0]
                if not NUMBER.fullmatch(word):
                    return refuse(self.path, self.where(line, byte), "a number", excerpt(word.decode("latin1")))
        return refuse(self.path, "line 1 (byte 0)", "numbers", "something else")
