"""Names of photographs without their suffixes, by which landmarks, cameras and photographs are matched."""

from pathlib import PurePosixPath

from neural_strands.preparation.photographs.folder import SUFFIXES

UNREAD_SUFFIXES = (
    *(".jpe", ".jfif", ".jp2", ".jxl", ".avif", ".gif", ".tga", ".exr", ".psd"),
    *(".dng", ".raw", ".cr2", ".cr3", ".crw", ".nef", ".nrw", ".arw", ".sr2", ".srf", ".srw", ".orf", ".raf", ".rw2"),
    *(".rwl", ".pef", ".x3f", ".iiq", ".3fr", ".fff", ".erf", ".mrw", ".gpr"),
)
"""Suffixes of pictures that are not read here: another program may have calibrated raw files."""


def stem_of(name: str) -> str:
    """The name of a photograph in small letters, without folders and without the suffix of a picture.

    Other dots are part of the name, as in those that tell the time: `at 14.30.22` stays whole.
    """
    path = PurePosixPath(name)
    return (path.stem if path.suffix.lower() in (*SUFFIXES, *UNREAD_SUFFIXES) else path.name).lower()
