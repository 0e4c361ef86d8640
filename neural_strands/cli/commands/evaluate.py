"""`neural-strands evaluate`: the paper's tables for a run, and its report."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.cli.streams import print_json


@dataclass(frozen=True)
class Evaluate:
    """Score a fit and write its report, RUN/report/index.html: one page that any browser opens."""

    run_folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Folder that `fit` wrote."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object: strands and lmvs (percent at each threshold, if there is a ground truth), counts (of
    strands, and of the segments of lmvs), strand_lengths (against the true ones: median and 95th percentile, metres,
    and their ratios, of the strands that grow within 4 mm of a true root), held_out_views (psnr in dB, ssim and lpips
    in the hair region; "psnr_at_exposure", after a gain per channel that is estimated outside the hair; the same under
    "image" for the whole image; the error of the "alpha" map; these are of pictures with grain over the hair like the
    photographs', the figures under "without_grain" of pictures as `render` shows them; "lpips_note", if LPIPS is absent
    or also a training loss), strands_in_views_percent (for the same views: "direction", drawn strands within 20 degrees
    of the photograph's streaks, hair "on_background", and "mask_on_background", the same share of the hair masks
    themselves), unseen_strands_percent, milliseconds, inside_head_percent."""

    def run(self) -> None:
        """Evaluate, write, print."""
        from neural_strands.evaluation.strands_in_view import HEADS as STRAND_HEADS
        from neural_strands.evaluation.strands_in_view import mean_strands_in_view
        from neural_strands.evaluation.view_quality import HEADS, mean_quality
        from neural_strands.runs.evaluate import evaluate_run, open_run
        from neural_strands.runs.report import write_report

        device = pick_device(self.device)
        run = open_run(self.run_folder, device)
        result = evaluate_run(run, device)
        write_report(run, result)
        figures = result.as_dict()
        if self.json:
            print_json(figures)
            return
        for name, what in (("lmvs", "segments"), ("strands", "strands")):
            for threshold, row in figures[name].items():
                sys.stdout.write(
                    f"{name:8} {threshold:10} precision {row['precision']:6.2f}  recall {row['recall']:6.2f}  "
                    f"F {row['f_score']:6.2f} %  {figures['counts'][name]} {what}\n"
                )
        if result.lengths is not None:
            sys.stdout.write(f"lengths of strands: {result.lengths.as_text()}\n")
        views = f"{len(result.views)} views, {'held out' if result.held_out else 'none held out: seen in training'}"
        for title, compared in ((f"mean of {views}", result.views), ("without grain over the hair", result.clean)):
            sys.stdout.write(f"{title}\n")
            for head, cell in zip(HEADS, mean_quality(compared).cells(), strict=True):
                sys.stdout.write(f"views    {head:16} {cell:>8}\n")
        for head, cell in zip(STRAND_HEADS, mean_strands_in_view(result.in_views).cells(), strict=True):
            sys.stdout.write(f"strands  {head:16} {cell:>8}\n")
        sys.stdout.write(f"strands that no photograph could see: {result.unseen:.1f} %\n")
        sys.stdout.write(f"{result.lpips_note}\n" if result.lpips_note else "")
        sys.stdout.write(f"decode {result.decode_ms:.1f} ms, render {result.render_ms:.1f} ms\n")
        sys.stdout.write(f"{run.folder.report / 'index.html'}\n")
