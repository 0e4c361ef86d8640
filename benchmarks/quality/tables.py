"""Makes the tables of docs/results.md by one command, which resumes where it was stopped.

    python benchmarks/quality/tables.py OUT [--data DATA] [--only TABLE ...] [--opensplat PROGRAM]

`geometry` is the paper's table 1: line segments and strands against the truth, beside the paper's rows. `pictures` is
its table 2: held-out views of ours and of rivals on the same images, and of blurred photographs, for PSNR and SSIM
reward blur. `times` is its table 3. `ablations` changes one thing at a time, on the first capture. `views` takes 24, 16
and 8 of the training views. Our pictures are scored with the photographs' grain over the hair, as `evaluate` draws it,
and without. Fits are repeated with several seeds: a figure is their mean, and ± half of their range.

DATA holds captures, each a folder, with true strands where geometry is to be judged. Each cell is kept in OUT/cells
(see table_cells.py). OUT/tables.md is written anew after each table; what is missing is named there.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import table_rows as rows
import tyro
from table_cells import Cells, Settings

from neural_strands.capture.capture import Capture
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, training_views
from neural_strands.evaluation.lpips import find_lpips
from neural_strands.fitting.config import Preset
from neural_strands.foundation.files import atomic_file, write_json

TITLES = {
    "geometry": "Geometry (percent; the paper's table 1)",
    "pictures": "Held-out views, over the hair (the paper's table 2)",
    "times": "A frame, milliseconds (the paper's table 3)",
    "ablations": "Ablations",
    "views": "Fewer training views",
}
"""Tables, in the order in which they are made."""
Table = Literal["geometry", "pictures", "times", "ablations", "views"]


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the cells and of tables.md."""
    data: Path = Path("../shared/data/captures")
    """Folder of captures."""
    only: tuple[Table, ...] = ()
    """Tables to make; all by default."""
    captures: tuple[str, ...] = ()
    """Names of captures; all in DATA by default."""
    seeds: int = 3
    """How many seeds each fit and ablation is repeated with."""
    views: tuple[int, ...] = (24, 16, 8)
    """Numbers of training views."""
    preset: Preset = "fast"
    """Of our fits."""
    steps: int | None = None
    """Of our fits and ablations; by default the preset's for fits, and few, in small regions, for ablations."""
    opensplat: Path | None = None
    """OpenSplat's program (see benchmarks/rivals/opensplat.py)."""
    positions_prior: Path | None = None
    """Weights of a prior that outputs positions, for the ablations; by default they are trained (some 11 minutes) and
    kept in OUT."""
    rival_minutes: float | None = None
    """Of a processor, for each rival; by default as many as our fit of the same views."""


def main(arguments: Arguments) -> None:
    """Make the tables one by one."""
    captures = chosen_captures(arguments)
    settings = Settings(arguments.preset, arguments.steps, HOLD_OUT_EVERY, arguments.rival_minutes)
    check_settings(arguments.out, settings)
    cells = Cells(arguments.out, settings, arguments.opensplat, arguments.positions_prior)
    made: dict[str, str] = {}
    for name, title in TITLES.items():
        if arguments.only and name not in arguments.only:
            continue
        made[title] = table(name, cells, captures, arguments)
        with atomic_file(arguments.out / "tables.md") as temporary:
            temporary.write_text(page(made), encoding="utf-8")
    print(page(made), end="")


def table(name: str, cells: Cells, captures: list[Path], arguments: Arguments) -> str:
    """One table, with everything that it needs computed first."""
    seeds = range(arguments.seeds)
    if name == "ablations":
        found = [cells.ablations(captures[0], seed) for seed in seeds]
        return rows.lacks(found) or rows.ablations({name: [each[name] for each in found] for name in found[0]})
    if name == "views":
        scores = {}
        for capture in captures:
            most = len(training_views(len(Capture.load(capture)), HOLD_OUT_EVERY))
            for count in (count for count in arguments.views if count < most):
                scores[f"{capture.name}, {count}"] = (cells.fewer(capture, count), cells.fewer_splats(capture, count))
        return rows.fewer_views(scores)
    fits = {capture.name: [cells.fit(capture, seed) for seed in seeds] for capture in captures}
    if name == "times":
        return rows.times(fits)
    rulers = {capture.name: cells.rulers(capture) for capture in captures}
    if name == "geometry":
        return rows.geometry(fits, rulers)
    return rows.pictures(fits, {capture.name: cells.splats(capture) for capture in captures}, rulers)


def page(made: dict[str, str]) -> str:
    """All tables so far, and what holds for all of them."""
    _, absent = find_lpips("squeeze", fetch=False)
    notes = "A figure is the mean over the seeds, ± half of their range. LPIPS (squeeze) is also a loss of our fits."
    parts = [notes if not absent else f"{notes} {absent}"]
    for title, text in made.items():
        parts += [f"## {title}", text]
    return "\n\n".join(parts) + "\n"


def chosen_captures(arguments: Arguments) -> list[Path]:
    """Folders of the captures that are asked for."""
    found = {path.parent.name: path.parent for path in sorted(arguments.data.glob("*/transforms.json"))}
    if unknown := set(arguments.captures) - set(found):
        raise SystemExit(f"{arguments.data}: expected captures {', '.join(sorted(unknown))}, found {', '.join(found)}.")
    if not found:
        raise SystemExit(f"{arguments.data}: expected folders of captures, found none; name their folder with --data.")
    return [path for name, path in found.items() if not arguments.captures or name in arguments.captures]


def check_settings(out: Path, settings: Settings) -> None:
    """Refuse to mix cells that were made with different settings."""
    path = out / "settings.json"
    if not path.is_file():
        write_json(path, asdict(settings))
    if json.loads(path.read_text()) != asdict(settings):
        raise SystemExit(f"{out}: was made with other settings (settings.json); choose another folder.")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
