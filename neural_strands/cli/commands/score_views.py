"""`neural-strands score-views`: renderings of a capture's views, by any renderer, against its photographs."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from neural_strands.capture.hold_out import HOLD_OUT_EVERY, held_out_views
from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.cli.streams import print_json
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track

if TYPE_CHECKING:
    from neural_strands.capture.capture import Capture


@dataclass(frozen=True)
class ScoreViews:
    """Score renderings of a capture's views: PSNR (dB), SSIM and LPIPS over the hair region and over the whole image.

    A rendering is an image with the name and size of its photograph, seen by the capture's camera without lens
    distortion. An alpha channel is taken as the opacity of the hair and compared with the hair mask: mean absolute
    error, and intersection over union of the outlines. Colours are compared as they are stored, so renderings of hair
    alone have no meaningful scores over the whole image.
    """

    renderings: Annotated[Path, tyro.conf.Positional]
    """Folder of the renderings: PNG, or another format of images."""
    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture: photographs, cameras, hair masks."""
    every: int = HOLD_OUT_EVERY
    """Score one view in this many, the last of each group; the default scores the views that `fit` holds out."""
    all_views: bool = False
    """Score all views instead."""
    lpips: Literal["squeeze", "alex", "vgg"] = "squeeze"
    """Network of LPIPS. `fit` trains with squeeze: choose another to judge its result by an independent metric."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object: "views" (each with name, hair, image, alpha), "mean" of the same, "lpips" (network,
    whether it is a training loss of `fit`, why it is absent). Null stands for absent values, and for the PSNR of
    identical images."""

    def run(self) -> None:
        """Match, read, compare, print."""
        from neural_strands.capture.capture import Capture
        from neural_strands.evaluation.lpips import find_lpips, training_note
        from neural_strands.evaluation.rendered_files import match_renderings, read_rendered_views
        from neural_strands.evaluation.view_quality import HEADS, mean_quality, view_qualities

        capture = Capture.load(self.capture)
        indices = self._indices(capture)
        paths = match_renderings(self.renderings, capture, indices)
        device = pick_device(self.device)
        metric, absent = find_lpips(self.lpips, device)
        views = read_rendered_views(paths, capture, indices, device)
        scores = view_qualities(track(views, "scoring", len(paths)), metric)
        means = mean_quality(scores)
        note = training_note(self.lpips)
        if self.json:
            rows = [{"name": score.view.name, **score.quality.as_dict()} for score in scores]
            lpips = {"network": self.lpips, "training_loss_of_fit": bool(note), "absent": absent}
            print_json(_plain({"views": rows, "mean": means.as_dict(), "lpips": lpips}))
            return
        rows = [(score.view.name, *score.quality.cells()) for score in scores]
        sys.stdout.write(_table([("view", *HEADS), *rows, ("mean", *means.cells())]))
        for line in (absent, note):
            sys.stdout.write(f"{line}\n" if line else "")

    def _indices(self, capture: "Capture") -> list[int]:
        """The views that are asked for.

        Raises:
            InputError: none is.
        """
        if self.all_views:
            return list(range(len(capture)))
        if self.every < 1:
            raise InputError(f"--every: expected 1 or more, found {self.every}.")
        indices = held_out_views(len(capture), self.every)
        if not indices:
            raise InputError(
                f"{self.capture}: expected at least {self.every} views, one of them held out, found {len(capture)}; "
                "give --all-views or a smaller --every."
            )
        return indices


def _table(rows: list[tuple[str, ...]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "".join(f"{line}\n" for line in lines)


def _plain(value: Any) -> Any:
    """The same with null in place of numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
