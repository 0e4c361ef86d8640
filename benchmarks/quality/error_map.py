"""Where the remaining error of a fitted run lies, and what causes it.

    python benchmarks/quality/error_map.py RUN [--out FOLDER]

For the held-out views, the squared error over the hair (PSNR's, in units of 1e-5) is split by the distance to the
mask's border, by fineness, by highlights and by cause (see error_split.py); parts add up to the total. Prints one JSON
object with the means over the views and the figures of each. FOLDER (RUN/error_map by default) gets a picture for each
view: photograph, rendering, and a map of the causes, which is as bright as the error around a pixel is large.
"""

import json
import sys
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

import torch
import tyro
from error_split import COARSE, NEAR, ErrorSplit, by_border, error_bands, split_error
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from torch import Tensor

from neural_strands.evaluation.view_quality import RenderedView
from neural_strands.foundation.precision import exact_convolutions
from neural_strands.pictures.encoding import write_png
from neural_strands.pictures.plots import DPI, figure_image
from neural_strands.raster.texture import blur_texture
from neural_strands.runs.evaluate import open_run

COLOURS = {"outline": (0.90, 0.60, 0.0), "light and colour": (0.35, 0.70, 0.90), "detail": (0.0, 0.75, 0.45)}
"""Colours of the causes in the map."""
BRIGHT = 0.1
"""Error around a pixel, as the root of its mean square, that is drawn in the full colour of its cause."""
SPREAD = 1.0
"""Standard deviation of the Gaussian over which the brightness of the map is averaged, pixels."""
MARGIN = 12
"""Pixels that are shown around the hair."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of a run."""
    out: Path | None = None
    """Folder of the pictures; RUN/error_map by default."""


def cause_map(
    rendered: Float[Tensor, "height width 3"],
    photograph: Float[Tensor, "height width 3"],
    hair: Bool[Tensor, "height width"],
) -> Float[Tensor, "height width 3"]:
    """A picture in which each pixel of the hair has the colour of the cause that matters most around it."""
    difference = (rendered - photograph) * hair[..., None]
    smooth = error_bands(difference, hair)[f"coarser than {COARSE:g} px"]

    def around(error: Tensor, sigma: float) -> Tensor:
        return blur_texture(error.square().mean(dim=2, keepdim=True), sigma)[..., 0].clamp(min=0)

    is_smooth = around(smooth, COARSE) > around(difference - smooth, COARSE)
    outline = by_border(hair)[f"within {NEAR:g} px"]
    colours = {name: torch.tensor(colour) for name, colour in COLOURS.items()}
    picture = torch.where(is_smooth[..., None], colours["light and colour"], colours["detail"])
    picture = torch.where(outline[..., None], colours["outline"], picture)
    bright = (around(difference, SPREAD).sqrt() / BRIGHT).clamp(max=1)
    return picture * (bright * hair)[..., None]


def beside(view: RenderedView, split: ErrorSplit) -> Float[Tensor, "height width 3"]:
    """Photograph, rendering and map of the causes, around the hair."""
    hair = view.hair_region()
    row, column = torch.nonzero(hair).T
    part = tuple(slice(max(int(index.min()) - MARGIN, 0), int(index.max()) + MARGIN + 1) for index in (row, column))
    figure = Figure(figsize=(12, 5.6), dpi=DPI, layout="constrained")
    axes: Any = figure.subplots(1, 3)
    pictures = {
        f"{view.name}: photograph": view.photograph,
        f"rendering, squared error {split.total:.0f}e-5": view.rendered,
        "causes of the error": cause_map(view.rendered, view.photograph, hair),
    }
    for panel, (title, picture) in zip(axes, pictures.items(), strict=True):
        panel.set_axis_off()
        panel.set_title(title, fontsize=10)
        panel.imshow(picture[part].numpy(), interpolation="nearest")
    causes = [Patch(color=COLOURS[name], label=f"{name} {value:.0f}") for name, value in split.parts["cause"].items()]
    axes[2].legend(handles=causes, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, fontsize=8, frameon=False)
    return figure_image(figure)


def means(splits: list[ErrorSplit]) -> dict[str, Any]:
    """Means over the views, each part under its name."""

    def over(field: str) -> dict[str, dict[str, float]]:
        first = getattr(splits[0], field)
        return {
            name: {part: round(fmean(getattr(each, field)[name][part] for each in splits), 1) for part in parts}
            for name, parts in first.items()
        }

    return {"total": round(fmean(each.total for each in splits), 1), "parts": over("parts"), "pixels": over("pixels")}


@torch.no_grad()
def main(arguments: Arguments) -> None:
    """Render, split and draw the views of a run."""
    contents = open_run(arguments.run, torch.device("cpu"))
    model = contents.renderer.model
    # As scores are: in float32.
    model.config = replace(model.config, mixed_precision=False)
    out = arguments.out or arguments.run / "error_map"
    out.mkdir(parents=True, exist_ok=True)
    photographs, splits = contents.capture.views_on(), {}
    for index in contents.shown:
        view = photographs[index]
        with exact_convolutions():
            output = contents.renderer.render(view.camera)
        compared = RenderedView(view.camera.name, output.rgb.clamp(0, 1), view.image, view.hair_mask, output.alpha)
        if not bool(compared.hair_region().any()):
            continue
        name = Path(view.camera.name).stem
        splits[name] = split_error(compared.rendered, compared.photograph, compared.hair_region())
        write_png(out / f"{name}.png", beside(compared, splits[name]))
    if not splits:
        raise SystemExit(f"{arguments.run}: expected views that show hair, found none.")
    found = {
        "held_out": contents.held_out,
        "views": len(splits),
        **means(list(splits.values())),
        "by_view": {name: asdict(split) for name, split in splits.items()},
    }
    sys.stdout.write(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
