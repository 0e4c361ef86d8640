"""Shadows after a haircut: an edited render against path-traced pictures of the same haircut.

    python benchmarks/quality/haircut.py --out haircut

A groom is path traced before and after a haircut, with the same cameras, lights and pigments. Appearance is fitted to
the pictures before the haircut, on the true strands, so that geometry plays no role. Then the true strands are cut and
rendered in four ways: as an edit (relit, with uncovered skin in the colour of the skin around it); with that skin as
the fit left it; with the density of the remaining hair but the light before the cut; and with everything unchanged.
Scores are over the hair in the pictures after the haircut, which the fit has not seen. Bias is the mean of render minus
truth there, in 8-bit levels; uncovered is the PSNR of the skin that hair hid before. Prints one JSON object, and writes
rows of pictures under --out: before, rendered and true; after, rendered in these four ways, and true.
"""

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import torch
import tyro
from appearance import Arguments as Fitting
from appearance import scores, strand_segments, summary

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.editing.haircut import cut_hair
from neural_strands.editing.settings import Haircut
from neural_strands.evaluation.lpips import find_lpips
from neural_strands.fitting.fit import fit, start_fit
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View
from neural_strands.model.files import load_hair_model, save_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.model.renderer import HairRenderer
from neural_strands.pictures.encoding import write_png
from neural_strands.prior.generator import StrandGenerator
from neural_strands.scalp.head import Head
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import attach_roots
from neural_strands.synthesis.dome import DomeConfig
from neural_strands.synthesis.groom import covering_widths, make_groom
from neural_strands.synthesis.path_tracer import PathTracer, TracingConfig
from neural_strands.synthesis.styles import STYLES, StyleName
from neural_strands.synthesis.synthesize import SynthesisConfig, synthesize


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    out: Path = Path("haircut")
    """Folder of the capture, the model and the pictures; finished views and a fitted model in it are reused."""
    style: StyleName = "straight"
    """Style of the groom."""
    strands: int = 4000
    """Strands of the groom."""
    length: float = 0.1
    """Length of the hair after the haircut, metres."""
    plane: tuple[float, float, float, float, float, float] | None = None
    """A point and the normal of a plane: cuts off what lies beyond it, instead of cutting to a length."""
    views: int = 14
    """Cameras; every fifth is held out of the fit."""
    size: int = 192
    """Side of the pictures, pixels."""
    samples: int = 16
    """Light paths per pixel."""
    steps: int = 1500
    """Gradient steps of the fit."""
    seed: int = 0
    """Seed of the groom, the noise and the fit."""

    @property
    def haircut(self) -> Haircut:
        """The haircut."""
        return Haircut(length=self.length) if self.plane is None else Haircut(plane=self.plane)


def captured(arguments: Arguments) -> tuple[Capture, SynthesisConfig]:
    """Synthesise the capture before the haircut; finished views are kept."""
    head, tracing = mannequin(), TracingConfig(samples=arguments.samples)
    config = SynthesisConfig(DomeConfig(arguments.views, arguments.size), tracing, arguments.seed)
    random = torch.Generator().manual_seed(arguments.seed)
    groom = make_groom(head, STYLES[arguments.style], config.tracing.melanin, arguments.strands, random)
    folder = arguments.out / "capture"
    synthesize(folder, head, groom, config, {"style": arguments.style, "strands": arguments.strands})
    return Capture.load(folder), config


def pictures_after(
    head: Head, before: Strands, after: Strands, config: SynthesisConfig, views: list[View]
) -> list[View]:
    """Path trace the cut hair from the same cameras, in the same light."""
    middle = (before.points.amin(dim=(0, 1)) + before.points.amax(dim=(0, 1))) / 2
    tracer = PathTracer(head, after, config.tracing, torch.Generator().manual_seed(config.seed), middle)
    found = []
    for index, view in enumerate(views):
        hair, person = tracer.coverage(view.camera).unbind(dim=-1)
        found.append(View(view.camera, tracer.image(view.camera, index), hair, person))
    return found


def fitted(arguments: Arguments, capture: Capture, head: Head, strands: Strands) -> HairModel:
    """Fit the appearance to the pictures before the haircut."""
    config = Fitting(steps=arguments.steps, crop=96, seed=arguments.seed).config()
    roots = attach_roots(head, strands.points[:, 0])
    random = torch.Generator().manual_seed(arguments.seed)
    model = HairModel(config.model, roots, StrandGenerator(), head.mesh, random)
    lpips, _ = find_lpips("squeeze", fetch=False)
    state = start_fit(model, config)
    state.show(strands.points)
    data = gather_fit_data(capture, head, strand_segments(strands), config, torch.device("cpu"))
    fit(state, data, config, lpips)
    return model.eval()


def compared(
    model: HairModel, strands: Strands, after: Strands, views: list[View], truth: list[View], out: Path
) -> dict[str, object]:
    """Scores of all renders, and pictures side by side."""
    lpips, reason = find_lpips("squeeze", fetch=False)
    uncut = HairRenderer.of(model, strands)
    new = uncut.showing(after)
    assert new.light is not None
    learned = replace(new.light.skin, share=torch.zeros_like(new.light.skin.share))
    renderers = {
        "lit_anew": new,
        "skin_as_learned": replace(new, light=replace(new.light, skin=learned)),
        "follows_the_cut": replace(new, light=None),
        "ignores_the_cut": replace(new, light=None, volume=uncut.volume),
    }
    rows: dict[str, list[list[float]]] = {name: [] for name in ("before", *renderers)}
    biases: dict[str, list[float]] = {name: [] for name in renderers}
    errors: dict[str, list[torch.Tensor]] = {name: [] for name in renderers}
    for view, true in zip(views, truth, strict=True):
        first = uncut.render(view.camera).rgb
        rows["before"].append(scores(first, view, lpips))
        pictures = [first, view.image]
        assert view.hair_mask is not None
        assert true.hair_mask is not None
        assert true.person_mask is not None
        hair = true.hair_mask > 0.5
        uncovered = (view.hair_mask > 0.95) & (true.hair_mask < 0.05) & (true.person_mask > 0.95)
        for name, renderer in renderers.items():
            picture = renderer.render(true.camera).rgb
            rows[name].append(scores(picture, true, lpips))
            error = picture.clamp(0, 1) - true.image
            biases[name].append(255 * float(error[hair].mean()))
            errors[name].append(error[uncovered].flatten())
            pictures.append(picture)
        write_png((out / "rows" / view.camera.name).with_suffix(".png"), torch.cat([*pictures, true.image], dim=1))
    figures: dict[str, object] = {name: summary(values) for name, values in rows.items()}
    for name, values in biases.items():
        figures[f"bias_{name}"] = round(sum(values) / len(values), 2)
        figures[f"uncovered_{name}"] = round(-10 * float(torch.cat(errors[name]).square().mean().log10()), 2)
    return {**figures, "lpips": reason or "squeeze"}


def main(arguments: Arguments) -> None:
    """Trace, fit, cut, compare, print."""
    keep_freed_memory()
    begin = time.perf_counter()
    capture, config = captured(arguments)
    if capture.ground_truth is None:
        sys.exit(f"{capture.folder}: expected ground_truth.npz, found none")
    head = find_head(capture)
    points = capture.ground_truth.points
    # A cut leaves widths as they are; without them the tracer would let the cut strands taper.
    strands = Strands(points, attach_roots(head, points[:, 0]).uv, width=covering_widths(points))
    after = cut_hair(arguments.haircut, strands)
    views = capture.views_on("cpu")
    everything = [views[index] for index in range(len(capture))]
    truth = pictures_after(head, strands, after, config, everything)
    traced = time.perf_counter()
    if not (arguments.out / "model").is_dir():
        save_hair_model(fitted(arguments, capture, head, strands), arguments.out / "model", {"benchmark": "haircut"})
    model = load_hair_model(arguments.out / "model").eval()
    figures = compared(model, strands, after, everything, truth, arguments.out)
    minutes = {"traced": (traced - begin) / 60, "fitted_and_scored": (time.perf_counter() - traced) / 60}
    figures |= {f"minutes_{name}": round(value, 1) for name, value in minutes.items()}
    sys.stdout.write(json.dumps(figures) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
