"""What fuzzing knows of a reader."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FuzzedReader:
    """One way in.

    Attributes:
        name: of the reader and its format.
        file: what is damaged, in the corpus.
        read: takes that file; what it returns is whole and finite.
        is_slow: whether it takes more than some hundredths of a second.
    """

    name: str
    file: str
    read: Callable[[Path], object]
    is_slow: bool = False
