"""`neural-strands fit-head`: a head for a capture that has none."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.head_options import HeadOptions
from neural_strands.cli.streams import print_json, say
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.bounds import MetresPerUnit


@dataclass(frozen=True)
class FitHead(HeadOptions):
    """Fit a head with a scalp to the face in the photographs of a capture that has no head.

    The head is placed where the cameras see it, so the cameras must be in metres, or --scale must convert them. Use it
    with `fit CAPTURE RUN --head OUT/head.obj`, or with any other command that takes --head.
    """

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder for head.obj and scalp_faces.json; it can be the folder of the capture."""
    scale: MetresPerUnit = 1.0
    """Metres in one unit of the cameras."""
    json: bool = False
    """Print the figures as one JSON object."""

    def run(self) -> None:
        """Fit, saying what happens on standard error, and write the head."""
        from neural_strands.capture.capture import Capture
        from neural_strands.capture.writer import CaptureWriter
        from neural_strands.preparation.head_of_capture import head_of_capture

        if (self.out / "head.obj").exists():
            raise InputError(f"{self.out / 'head.obj'}: expected no head yet, found one; name another folder.")
        found = head_of_capture(Capture.load(self.capture), self.head_request(self.scale), say)
        CaptureWriter(self.out).write_head(found.mesh, found.scalp)
        if self.json:
            print_json({**found.figures, "scalp_faces": len(found.scalp)})
            return
        sys.stdout.write(f"{self.out / 'head.obj'}: {len(found.mesh.vertices)} vertices\n")
