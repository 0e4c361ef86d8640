"""The cost of imperfect input: one capture with one thing wrong at a time, and F of the resulting strands.

    python benchmarks/quality/imperfect.py CAPTURE OUT [--preset fast] [--only NAME ...] [--steps 80]

The capture needs a head, hair masks and true strands. Each variant spoils one kind of input: the head (shifted, bent
smoothly, scaled), the hair masks (eroded, dilated), the cameras (turned at random, so that points move by half a
pixel) or the exposure (within one stop). Everything after that is done anew: correction of the masks, stereo, roots,
first strands and `--steps` steps of the shape alone. A variant that is finished in OUT is not run again. Prints a
table: F at 1 mm/10°, 2 mm/20° and 3 mm/30° of first strands and of those that the steps leave, and what of F at 2 mm
was lost.
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
import tyro
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture, grown
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import training_views
from neural_strands.capture.mask_border import MOST_VIEWS, growth_of
from neural_strands.evaluation.geometry_metrics import THRESHOLDS, score_geometry
from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.fitting.config import FitConfig, Preset, preset
from neural_strands.fitting.first_model import begin, fit_prior
from neural_strands.fitting.fit import fit
from neural_strands.fitting.fit_data import FitData, head_distance_grid
from neural_strands.fitting.losses import OrientedTargets
from neural_strands.foundation.files import write_json
from neural_strands.foundation.progress import track
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.views import View, Views
from neural_strands.lmvs.growth import orient_segments
from neural_strands.lmvs.reconstruct import reconstruct
from neural_strands.scalp.head import Head

STRICT = THRESHOLDS[:3]
"""Reported thresholds."""
BEND = 0.08
"""Metres over which a bent head's displacement varies."""
ASIDE = (0.6, 0.6, -0.53)
"""Direction in which heads are shifted: to one side, up and backwards."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Annotated[Path, tyro.conf.Positional]
    """A capture with head, hair masks and true strands."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of finished variants."""
    preset: Preset = "fast"
    """Settings of stereo, first strands and steps."""
    only: tuple[str, ...] = ()
    """Names of variants; none: all."""
    steps: int = 80
    """Steps of the shape alone."""


@dataclass(frozen=True)
class Input:
    """The input of a fit: photographs with cameras and masks, and a head."""

    views: tuple[View, ...]
    head: Head


Spoil = Callable[[Input], Input]


def moved_head(given: Input, displaced: Callable[[Float[Tensor, "vertex 3"]], Float[Tensor, "vertex 3"]]) -> Input:
    """The head with other vertices; its scalp keeps its faces and its chart."""
    mesh = given.head.mesh
    return replace(given, head=replace(given.head, mesh=replace(mesh, vertices=displaced(mesh.vertices))))


def shifted(metres: float) -> Spoil:
    """Shift the whole head."""
    offset = metres * torch.nn.functional.normalize(torch.tensor(ASIDE), dim=0)
    return lambda given: moved_head(given, lambda vertices: vertices + offset)


def scaled(factor: float) -> Spoil:
    """Scale the head about the middle of its scalp."""

    def change(given: Input) -> Input:
        mesh = given.head.mesh
        middle = mesh.vertices[mesh.faces[given.head.scalp_faces].reshape(-1)].mean(dim=0)
        return moved_head(given, lambda vertices: middle + factor * (vertices - middle))

    return change


def bent(metres: float, seed: int = 0) -> Spoil:
    """Displace the head by a smooth random field with a given root mean square over the scalp, metres."""

    def change(given: Input) -> Input:
        random = torch.Generator().manual_seed(seed)
        # A sum of plane waves is a smooth random field.
        waves = torch.randn(64, 3, generator=random) / BEND
        phases = 2 * torch.pi * torch.rand(64, generator=random)
        strength = torch.randn(64, 3, generator=random)
        mesh = given.head.mesh
        field = torch.cos(mesh.vertices @ waves.T + phases) @ strength
        scalp = mesh.faces[given.head.scalp_faces].reshape(-1).unique()
        size = field[scalp].square().sum(dim=1).mean().sqrt()
        return moved_head(given, lambda vertices: vertices + metres * field / size)

    return change


def resized_masks(pixels: int) -> Spoil:
    """Dilate hair masks by a number of pixels, or erode them if it is negative."""

    def change(view: View) -> View:
        assert view.hair_mask is not None
        return replace(view, hair_mask=torch.from_numpy(grown(view.hair_mask.numpy(), pixels)))

    return lambda given: replace(given, views=tuple(change(view) for view in given.views))


def turned_cameras(pixels: float, seed: int = 0) -> Spoil:
    """Rotate cameras about a random axis across the view, so that the middle moves by a number of pixels."""

    def change(given: Input) -> Input:
        random = np.random.default_rng(seed)
        views = []
        for view in given.views:
            camera, angle = view.camera, random.uniform(0, 2 * np.pi)
            turn = pixels / float(camera.intrinsics[0, 0]) * np.array([np.cos(angle), np.sin(angle), 0.0])
            pose = camera.world_to_camera.clone()
            pose[:3] = torch.from_numpy(cv2.Rodrigues(turn)[0]).to(pose) @ pose[:3]
            views.append(replace(view, camera=replace(camera, world_to_camera=pose)))
        return replace(given, views=tuple(views))

    return change


def exposed(stops: float, seed: int = 0) -> Spoil:
    """Make photographs brighter or darker at random, within a total range of stops, with clipping."""

    def change(given: Input) -> Input:
        random = torch.Generator().manual_seed(seed)
        gains = 2 ** (stops * (torch.rand(len(given.views), generator=random) - 0.5))
        views = [
            replace(view, image=to_srgb(gain * to_linear(view.image)).clamp(0, 1))
            for view, gain in zip(given.views, gains, strict=True)
        ]
        return replace(given, views=tuple(views))

    return change


def together(*spoils: Spoil) -> Spoil:
    """Apply several defects in turn."""

    def change(given: Input) -> Input:
        for spoil in spoils:
            given = spoil(given)
        return given

    return change


VARIANTS: dict[str, Spoil] = {
    "as it is": lambda given: given,
    "head shifted by 3 mm": shifted(0.003),
    "head shifted by 5 mm": shifted(0.005),
    "head bent by 3 mm": bent(0.003),
    "head bent by 5 mm": bent(0.005),
    "head 2% larger": scaled(1.02),
    "head 2% smaller": scaled(0.98),
    "masks eroded by 2 px": resized_masks(-2),
    "masks eroded by 4 px": resized_masks(-4),
    "masks dilated by 2 px": resized_masks(2),
    "masks dilated by 4 px": resized_masks(4),
    "cameras off by 0.5 px": turned_cameras(0.5),
    "exposure within one stop": exposed(1.0),
    "head bent by 3 mm, masks dilated by 2 px, cameras and exposure": together(
        bent(0.003), resized_masks(2), turned_cameras(0.5), exposed(1.0)
    ),
}


def corrected(given: Input) -> tuple[Input, int]:
    """Correct the masks' borders as a fit does; also returns by how much."""
    seen = [(view.image, view.hair_mask) for view in given.views if view.hair_mask is not None]
    chosen = seen[:: max(1, -(-len(seen) // MOST_VIEWS))]
    growth = growth_of([((255 * image).round().byte().numpy(), mask.numpy()) for image, mask in chosen])
    return (resized_masks(growth)(given) if growth else given), growth


@dataclass(frozen=True)
class Row:
    """The figures of one variant."""

    name: str
    strands: int
    segments: int
    grown: int
    """Pixels by which the masks were grown."""
    first: list[float]
    """F of first strands at each threshold, percent."""
    shaped: list[float]
    """F after the steps."""


def score(name: str, given: Input, truth: Float[Tensor, "strand point 3"], config: FitConfig) -> Row:
    """Run stereo, initial strands and steps on this input."""
    given, growth = corrected(given)
    views, mesh = Views.in_memory(given.views), given.head.mesh
    random = torch.Generator().manual_seed(config.seed)
    segments = reconstruct(views, mesh, config.stereo, random, None, track)
    segments = orient_segments(segments, mesh, given.head.scalp_faces, [], config.growth)
    grid = PointGrid.build(segments.points, config.chamfer.surface_radius / 2)
    targets = OrientedTargets(segments.points, segments.directions, grid)
    data = FitData(views, given.head, segments, targets, head_distance_grid(mesh))
    state = begin(data, fit_prior(None, torch.device("cpu")), config)
    true = sample_strands(truth)
    figures = []
    for steps in (0, config.steps):
        fit(state, data, replace(config, steps=steps))
        with torch.no_grad():
            ours = sample_strands(state.model.decode().points)
        scores = score_geometry(ours, true, STRICT, with_consistency=False)
        figures.append([round(each.unsigned.f_score, 2) for each in scores])
    return Row(name, config.strands, len(segments), growth, *figures)


def table(rows: list[Row]) -> str:
    """Markdown, with what each variant lost of F at 2 mm."""
    lines = [
        "| input | strands | masks grown by | first strands | after the steps | lost at 2 mm |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        first, shaped = (" / ".join(f"{value:.1f}" for value in values) for values in (row.first, row.shaped))
        lost = f"{rows[0].shaped[1] - row.shaped[1]:.1f}"
        lines.append(f"| {row.name} | {row.strands} | {row.grown} px | {first} | {shaped} | {lost} |")
    return "\n".join(lines) + "\n"


def main(arguments: Arguments) -> None:
    """Run unfinished variants and print the table."""
    capture = Capture.load(arguments.capture)
    truth, base = capture.ground_truth, preset(arguments.preset)
    if truth is None:
        raise SystemExit(f"{arguments.capture}: expected a capture with true strands, found none.")
    unknown = sorted(set(arguments.only) - set(VARIANTS))
    if unknown:
        raise SystemExit(f"--only: expected names among {', '.join(VARIANTS)}, found {unknown[0]}.")
    schedule = replace(base.schedule, geometry_only=1.0)
    config = replace(base, steps=arguments.steps, schedule=schedule)
    kept = capture.subset(training_views(len(capture), config.hold_out_every)).views_on()
    given = Input(tuple(kept), find_head(capture))
    rows = []
    for name, spoil in VARIANTS.items():
        path = arguments.out / f"{name.replace(' ', '_').replace('%', '')}.json"
        if not path.is_file():
            if arguments.only and name not in arguments.only:
                continue
            row = score(name, spoil(given), truth.points, config)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_json(path, row.__dict__)
        rows.append(Row(**json.loads(path.read_text(encoding="utf-8"))))
        sys.stdout.write(f"{rows[-1]}\n")
    sys.stdout.write(table(rows))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
