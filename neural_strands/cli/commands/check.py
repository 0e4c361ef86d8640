"""`neural-strands check`: the contents of a capture folder and its problems."""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from neural_strands.cli.streams import print_json
from neural_strands.foundation.errors import InputError

if TYPE_CHECKING:
    from neural_strands.capture.findings import Finding

MARKS = {"good": "ok", "note": "-", "warning": "WARNING", "error": "ERROR"}


@dataclass(frozen=True)
class Check:
    """List in one table what a capture folder contains and what is wrong with it, before a long run.

    Checks the calibration, every image and mask, the head, the scale, where the cameras look, the range of viewpoints,
    blur and exposure, and says what to do about each. Exits with status 2 if something must be fixed first.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Holds transforms.json or a COLMAP model, and the images."""
    head: Path | None = None
    """Head mesh in the cameras' frame, metres, to check instead of the capture's own (see `fit --head`)."""
    sheet: Path | None = None
    """Draw all views into this PNG file, with the borders of hair mask (green), person mask (blue), head (yellow) and
    scalp (red), to look the masks over."""
    json: bool = False
    """Print one JSON object: "worst" (good, note, warning or error) and "findings", each with topic, level, message,
    action and views."""

    def run(self) -> None:
        """Run all checks, print the findings, and fail if there are errors."""
        from neural_strands.capture.checks import check_capture
        from neural_strands.capture.findings import worst

        findings = check_capture(self.folder, self.head)
        if self.sheet is not None:
            self._draw(self.sheet)
        if self.json:
            rows = [dataclasses.asdict(finding) for finding in findings]
            print_json({"worst": worst(findings), "findings": rows})
        else:
            sys.stdout.write(table(findings))
        errors = sum(finding.level == "error" for finding in findings)
        if errors:
            raise InputError(
                f"{self.folder}: expected a capture without errors, found one with {errors}; see the rows marked ERROR."
            )

    def _draw(self, sheet: Path) -> None:
        """Write the contact sheet."""
        from neural_strands.capture.capture import Capture
        from neural_strands.capture.check_head import check_head
        from neural_strands.capture.contact_sheet import write_contact_sheet

        capture = Capture.load(self.folder)
        head, scalp, _ = check_head(capture, self.head)
        write_contact_sheet(sheet, capture, head, scalp)


def table(findings: "list[Finding]") -> str:
    """The findings as text: one line each, followed by what to do."""
    width = max(len(finding.topic) for finding in findings)
    lines = []
    for finding in findings:
        lines.append(f"{MARKS[finding.level]:<8} {finding.topic:<{width}}  {finding.text}\n")
        if finding.action:
            lines.append(f"{'':<8} {'':<{width}}  -> {finding.action}\n")
    return "".join(lines)
