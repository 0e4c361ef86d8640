"""The tables of `tables.py` as Markdown: rows from finished cells, and those of the paper."""

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

LEVELS = {"1mm/10deg": "1 mm / 10°", "2mm/20deg": "2 mm / 20°", "3mm/30deg": "3 mm / 30°"}
MEASURES = {"psnr": 2, "ssim": 3, "lpips": 3, "flip": 3, "sharpness": 2}
"""Metrics of pictures over the hair, and their numbers of digits."""
PICTURE_HEADS = ("PSNR", "SSIM", "LPIPS", "FLIP", "sharpness")
PAPER_GEOMETRY = (
    ("paper, short: LMVS", "56.9 12.1 20.0", "93.4 30.3 45.8", "98.9 46.6 63.4"),
    ("paper, short: strands", "52.8 13.8 21.9", "92.9 48.4 63.6", "98.2 71.5 82.8"),
    ("paper, long: LMVS", "26.3 16.5 20.3", "75.1 39.1 51.5", "93.5 54.0 68.5"),
    ("paper, long: strands", "32.6 14.6 20.2", "71.4 42.1 52.9", "71.4 62.9 66.9"),
)
"""Table 1 of the paper: other grooms, with unknown numbers of strands."""
PAPER_PICTURES = (
    ("NeRF", "31.71", "0.9383", "0.1598"),
    ("MVP", "32.82", "0.9599", "0.1226"),
    ("Neural Strands", "31.30", "0.9452", "0.0811"),
)
"""Table 2 of the paper: nine held-out views of six real subjects, so not to be compared with rows of other images."""
PAPER_TIMES = (
    ("paper, NeRF", "-", "-", "27910"),
    ("paper, MVP", "20.4", "81.6", "102"),
    ("paper, Neural Strands", "34.5", "38.8", "73.4"),
)
"""Table 3 of the paper, one V100."""


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table; rows that are too short are filled up."""
    full = [(*row, *("" for _ in range(len(heads) - len(row)))) for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in (heads, ("---",) * len(heads), *full))


def over_seeds(values: Sequence[float | None], digits: int) -> str:
    """Mean over the seeds, and half of the range where there are several; a dash where a value is absent."""
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return "-"
    mean = f"{fmean(known):,.{digits}f}"
    return mean if len(known) == 1 else f"{mean} ± {0.5 * (max(known) - min(known)):.{digits}f}"


def geometry(cells: Mapping[str, Sequence[dict[str, Any]]], rulers: Mapping[str, dict[str, Any]]) -> str:
    """The paper's table 1.

    Args:
        cells: fits by capture, one a seed.
        rulers: of each capture: what one half of its true strands scores against the other.
    """
    heads = ("what", "strands", *(f"{level} P R F" for level in LEVELS.values()), "consistency", "inside the head, %")
    rows: list[Sequence[str]] = []
    for name, fits in cells.items():
        for label, part in ((f"{name}: LMVS", "segments"), (f"{name}: strands", "geometry")):
            if lack := lacks(fits):
                rows.append((label, lack))
            elif not all(fit[part] for fit in fits):
                rows.append((label, "true strands are not known"))
            elif part == "segments":
                rows.append((label, "-", *_shares([fit[part] for fit in fits])))
            else:
                count = over_seeds([fit["strands"] for fit in fits], 0)
                inside = over_seeds([fit.get("inside_head_percent") for fit in fits], 2)
                rows.append((label, count, *_shares([fit[part] for fit in fits]), _consistency(fits), inside))
        if half := rulers[name].get("half_against_half"):
            levels = (f"- - {half[level]:.1f}" for level in LEVELS)
            rows.append((f"{name}: half of the truth against the other", f"{rulers[name]['strands'] // 2:,}", *levels))
    return markdown(heads, [*rows, *((name, "-", *levels) for name, *levels in PAPER_GEOMETRY)])


def pictures(
    fits: Mapping[str, Sequence[dict[str, Any]]],
    splats: Mapping[str, dict[str, Any]],
    rulers: Mapping[str, dict[str, Any]],
) -> str:
    """The paper's table 2, with rivals on the same images and rows that show how much a measure rewards blur."""
    heads = ("capture", "what", *PICTURE_HEADS, "alpha error", "outline IoU", "primitives", "minutes of a processor")
    rows: list[Sequence[str]] = []
    for name, seeds in fits.items():
        if lack := lacks(seeds):
            rows.append((name, "ours", lack))
        else:
            rows.append((name, "ours", *_ours(seeds)))
            rows.append((name, "ours, without grain", *_measures([_clean(fit) for fit in seeds])))
        lack, rival = lacks([splats[name]]), (name, "3D Gaussian splats (OpenSplat)")
        rows.append((*rival, lack) if lack else (*rival, *_rival(splats[name])))
        if lack := lacks([rulers[name]]):
            rows.append((name, "photograph, blurred", lack))
        for blur, found in rulers[name].get("blurred", {}).items():
            rows.append((name, f"photograph, blurred by {blur}", *_measures([found])))
    return markdown(heads, [*rows, *(("paper's own", *row) for row in PAPER_PICTURES)])


def times(fits: Mapping[str, Sequence[dict[str, Any]]]) -> str:
    """The paper's table 3, milliseconds."""
    rows: list[Sequence[str]] = []
    for name, seeds in fits.items():
        if lack := lacks(seeds):
            rows.append((name, lack))
            continue
        decode, render = ([fit["milliseconds"][part] for fit in seeds] for part in ("decode", "render"))
        total = [sum(pair) for pair in zip(decode, render, strict=True)]
        strands = [fit["strands"] for fit in seeds]
        rows.append((name, *(over_seeds(values, 0) for values in (decode, render, total, strands))))
    return markdown(("what", "decode", "render", "total", "strands"), [*rows, *PAPER_TIMES])


def ablations(found: Mapping[str, Sequence[dict[str, Any]]]) -> str:
    """One thing changed at a time.

    Args:
        found: what `ablations.py` found, one for each seed, by variant.
    """
    levels = (f"{level} P R F" for level in LEVELS.values())
    heads = ("variant", "strands", *levels, "consistency at 2 mm", "inside the head, %", *PICTURE_HEADS[:3], "minutes")
    rows = []
    for name, seeds in found.items():
        row = [name, f"{seeds[0]['described']['strands']:,}"]
        if all(each["strands"] for each in seeds):
            row += _shares([each["strands"] for each in seeds])
            row.append(over_seeds([each["strands"]["2mm/20deg"]["strand_consistency"] for each in seeds], 1))
        else:
            row += ["-"] * (len(LEVELS) + 1)
        row.append(over_seeds([each.get("inside_head_percent") for each in seeds], 2))
        row += _measures([each["held_out_views"] for each in seeds])[:3]
        rows.append((*row, over_seeds([each["seconds"] / 60 for each in seeds], 1)))
    return markdown(heads, rows)


def fewer_views(found: Mapping[str, tuple[dict[str, Any], dict[str, Any]]]) -> str:
    """Scores with fewer training views.

    Args:
        found: our cell and the rival's, by a label of capture and number of views.
    """
    heads = ("views", "what", "primitives", "F at 1 / 2 / 3 mm", *PICTURE_HEADS)
    rows: list[Sequence[str]] = []
    for label, (mine, rival) in found.items():
        for what, cell, count in (("ours", mine, "strands"), ("splats", rival, "splats")):
            if lack := lacks([cell]):
                rows.append((label, what, lack))
                continue
            scores = cell.get("geometry")
            levels = " / ".join(f"{scores[level]['f_score']:.1f}" for level in LEVELS) if scores else "-"
            rows.append((label, what, f"{cell[count]:,}", levels, *_measures([cell["views"]])))
            if what == "ours":
                rows.append((label, "ours, without grain", "", "", *_measures([_clean(cell)])))
    return markdown(heads, rows)


def lacks(cells: Sequence[dict[str, Any]]) -> str:
    """What the first unfinished cell lacks; empty if all are finished."""
    return next((cell["missing"] for cell in cells if "missing" in cell), "")


def _ours(fits: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Our figures over the seeds, without the name."""
    alpha = [fit["views"].get("alpha") or {} for fit in fits]
    outline = (over_seeds([each.get(name) for each in alpha], 3) for name in ("mean_absolute_error", "outline_iou"))
    count, minutes = f"{fits[0]['strands']:,} strands", over_seeds([fit["minutes"] for fit in fits], 1)
    return (*_measures([fit["views"] for fit in fits]), *outline, count, minutes)


def _clean(fit: dict[str, Any]) -> dict[str, Any]:
    """Scores of pictures without the photographs' grain, as one sees them elsewhere."""
    return fit["views"]["without_grain"]["hair"]


def _rival(cell: dict[str, Any]) -> tuple[str, ...]:
    made = f"{cell['splats']:,} splats, {cell['iterations']:,} iterations"
    return (*_measures([cell["views"]]), "-", "-", made, f"{cell['processor_minutes']:.1f}")


def _measures(found: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    return tuple(over_seeds([each.get(name) for each in found], digits) for name, digits in MEASURES.items())


def _shares(found: Sequence[Mapping[str, Any]]) -> list[str]:
    """Precision, recall and F at each level; the spread of F alone, or nobody could read them."""
    cells = []
    for level in LEVELS:
        precision, recall = (fmean(each[level][share] for each in found) for share in ("precision", "recall"))
        cells.append(f"{precision:.1f} {recall:.1f} {over_seeds([each[level]['f_score'] for each in found], 1)}")
    return cells


def _consistency(fits: Sequence[dict[str, Any]]) -> str:
    """Strand consistency at each level."""
    return " / ".join(over_seeds([fit["geometry"][level]["strand_consistency"] for fit in fits], 1) for level in LEVELS)
