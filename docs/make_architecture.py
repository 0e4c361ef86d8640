"""Draw docs/pictures/architecture.svg: the packages and the module `api` on their layers, and what each imports.

    python docs/make_architecture.py            # write the picture
    python docs/make_architecture.py --check    # exit with status 1 if the picture is out of date

Layers are those of the import-linter contract in pyproject.toml. An arrow that a chain of other arrows implies is
left out. An arrow that skips layers passes between their boxes, at a place that is kept free for it (Sugiyama et al.
1981).
"""

import ast
import sys
import tomllib
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "neural_strands"
PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"
ROW, BOX, MARGIN, LETTER, PADDING, GAP, PASSAGE = 78, 30, 16, 8.4, 14, 18, 4
"""Sizes in pixels: distance between layers, height of a box, margin of the picture, width of a letter, padding beside a
name, distance between boxes, and width of a passage for an arrow."""
SWEEPS = 8

Imports = dict[str, set[str]]
"""The packages that each package imports."""
Route = list[str]
"""The boxes and passages of an arrow, one per layer, from the importing to the imported package."""


def layers() -> list[list[str]]:
    """Packages from top to bottom, those of one layer together."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = settings["tool"]["importlinter"]["contracts"][0]
    return [[name.strip() for name in layer.split("|")] for layer in contract["layers"]]


def imports() -> Imports:
    """Read the imports of every module, those inside functions included."""
    found: Imports = {name: set() for layer in layers() for name in layer}
    for name, used in found.items():
        for path in sorted((ROOT / PACKAGE / name).rglob("*.py")) or [ROOT / PACKAGE / f"{name}.py"]:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                parts = [module.split(".") for module in modules]
                used |= {part[1] for part in parts if part[0] == PACKAGE and len(part) > 1} & found.keys() - {name}
    return found


def reachable(graph: Imports, start: str) -> set[str]:
    """Every package that `start` imports, directly or through others."""
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        new = graph[waiting.pop()] - seen
        seen |= new
        waiting += new
    return seen


def reduced(graph: Imports) -> Imports:
    """The same graph without the arrows that chains of others imply (its transitive reduction)."""
    return {
        name: {one for one in used if not any(one in reachable(graph, other) for other in used - {one})}
        for name, used in graph.items()
    }


def routes(rows: list[list[str]], graph: Imports) -> list[Route]:
    """One route per arrow; passages are added to the rows."""
    layer = {name: number for number, row in enumerate(rows) for name in row}
    found: list[Route] = []
    for name, used in graph.items():
        for one in sorted(used):
            between = range(layer[name] + 1, layer[one])
            passages = [f"{name}>{one}:{number}" for number in between]
            for number, passage in zip(between, passages, strict=True):
                rows[number].append(passage)
            found.append([name, *passages, one])
    return found


def centres(rows: list[list[str]]) -> dict[str, float]:
    """Horizontal centre of everything, relative to the middle of the picture."""
    places: dict[str, float] = {}
    for row in rows:
        widths = [PASSAGE if ">" in name else LETTER * len(name) + 2 * PADDING for name in row]
        left = -(sum(widths) + GAP * (len(row) - 1)) / 2
        for name, width in zip(row, widths, strict=True):
            places[name] = left + width / 2
            left += width + GAP
    return places


def arrange(rows: list[list[str]], arrows: list[Route]) -> dict[str, float]:
    """Order every row by the mean place of its neighbours, down and up in turns; the centres that result."""
    steps = [step for route in arrows for step in pairwise(route)]
    for sweep in range(SWEEPS):
        down = sweep % 2 == 0
        for row in rows if down else reversed(rows):
            places = centres(rows)
            aims = {
                name: [places[above if down else below] for above, below in steps if name == (below if down else above)]
                for name in row
            }
            row.sort(key=lambda name: sum(aims[name]) / len(aims[name]) if aims[name] else places[name])
    return centres(rows)


def drawing() -> str:
    """The picture as SVG."""
    rows = layers()
    names = [list(row) for row in rows]
    arrows = routes(rows, reduced(imports()))
    places = arrange(rows, arrows)
    width = 2 * (max(abs(place) for place in places.values()) + 80)
    height = 2 * MARGIN + (len(rows) - 1) * ROW + BOX
    tops = {name: MARGIN + number * ROW for number, row in enumerate(rows) for name in row}
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height}" width="{width:.0f}" '
        f'height="{height}">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8Z" fill="#5b6770"/></marker></defs>',
        f'<rect width="{width:.0f}" height="{height}" fill="#ffffff"/>',
    ]
    for route in arrows:
        path = f"M{width / 2 + places[route[0]]:.1f} {tops[route[0]] + BOX}"
        for above, below in pairwise(route):
            start, end = width / 2 + places[above], width / 2 + places[below]
            top, bottom = tops[above] + BOX, tops[below]
            path += f" C{start:.1f} {top + 26} {end:.1f} {bottom - 26} {end:.1f} {bottom}"
            path += f" V{bottom + BOX}" if ">" in below else ""
        parts.append(f'<path d="{path}" fill="none" stroke="#5b6770" stroke-width="1.2" marker-end="url(#tip)"/>')
    for name in (name for row in names for name in row):
        middle, half = width / 2 + places[name], LETTER * len(name) / 2 + PADDING
        parts.append(
            f'<rect x="{middle - half:.1f}" y="{tops[name]}" width="{2 * half:.1f}" height="{BOX}" rx="5" '
            'fill="#eef4f8" stroke="#3b6e91"/>'
            f'<text x="{middle:.1f}" y="{tops[name] + 20}" text-anchor="middle" font-family="monospace" '
            f'font-size="14" fill="#1d2b36">{name}</text>'
        )
    return "\n".join([*parts, "</svg>", ""])


def main() -> int:
    """Write or check the picture; the exit status."""
    if "--check" in sys.argv[1:]:
        current = PICTURE.read_text(encoding="utf-8") if PICTURE.is_file() else ""
        if current != drawing():
            sys.stderr.write(f"{PICTURE.relative_to(ROOT)} is out of date; run python docs/make_architecture.py.\n")
            return 1
        return 0
    PICTURE.write_text(drawing(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
