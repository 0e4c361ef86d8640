"""Builds tables in the form of docs/results.md from the records of `gpu.py`."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

STEP = re.compile(r"^(.+?) +median +([\d.]+) ms, least +([\d.]+) ms", re.MULTILINE)
LEVELS = {"1mm/10deg": "1 mm / 10°", "2mm/20deg": "2 mm / 20°", "3mm/30deg": "3 mm / 30°"}
THRESHOLDS = {name: f"{label} P R F" for name, label in LEVELS.items()}
FRAMES = ("frame_64", "frame_512", "frame_1024")
GOALS = (
    ("`paper` preset, minutes", 10.0, "paper_fit", lambda record: record["seconds"] / 60),
    ("static frame, 1024 x 1024, ms", 5.0, "frame_1024", lambda record: record["milliseconds"]["static_frame"]),
    ("decode and frame, ms", 9.0, "frame_1024", lambda record: record["milliseconds"]["dynamic_frame"]),
    ("stereo, 60 views of 1024 x 1024, s", 60.0, "lmvs", lambda record: record["seconds"]),
)
"""Targets on one H200: name, target, part, and path of the figure in its record; whole commands include their start."""


def last_json(text: str) -> dict[str, Any]:
    """The JSON object that a program printed, on one line or on all of them."""
    for candidate in (text, *reversed(text.splitlines())):
        try:
            found = json.loads(candidate)
        except ValueError:
            continue
        if isinstance(found, dict):
            return found
    return said(text)


def said(text: str) -> dict[str, Any]:
    """The output of a program, and its last line separately."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return {"summary": lines[-1] if lines else "", "output": text[-8000:]}


def results(out: Path, about: Mapping[str, str], quick: bool = False) -> str:
    """All tables for which there are records; those of tiny versions of the parts say so and are set beside no goal."""
    records = {path.stem: json.loads(path.read_text()) for path in sorted(out.glob("*.json")) if _is_record(path)}
    failed = [path.name.removesuffix(".failed.json") for path in sorted(out.glob("*.failed.json"))]
    parts = ["## On a GPU", ", ".join(f"{name} {value}" for name, value in about.items())]
    if quick:
        parts.append("A trial with tiny sizes; none of these figures counts.")
    if failed:
        parts.append(f"Failed, see the logs: {', '.join(failed)}.")
    for title, found in (
        ("Goals", "" if quick else _goals(records)),
        ("The device against the CPU", _parity(records)),
        ("Frames, ms", _frames(records)),
        ("A step of the fit, median ms", _step(records)),
        ("Prior", _prior(records)),
        ("Geometry", _geometry(records)),
        ("Images", _images(records)),
        ("Rivals, over the hair of the held-out views", _rivals(records)),
    ):
        if found:
            parts += [f"### {title}", found]
    for name, heading in (("lines", "Lines, and OpenGL's"), ("lmvs", "Stereo")):
        if name in records:
            parts += [f"### {heading}", f"```\n{records[name]['output'].strip()}\n```"]
    return "\n\n".join(parts) + "\n"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; empty without rows."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) if rows else ""


def _is_record(path: Path) -> bool:
    return not path.name.endswith(".failed.json")


def _goals(records: Mapping[str, Any]) -> str:
    rows = [(name, f"{aim:g}", f"{take(records[part]):.4g}") for name, aim, part, take in GOALS if part in records]
    return table(("what", "aim on one H200", "found"), rows)


def _parity(records: Mapping[str, Any]) -> str:
    rows = [(name.removeprefix("parity_"), each["summary"]) for name, each in records.items() if "parity_" in name]
    return table(("tests", "outcome"), rows)


def _frames(records: Mapping[str, Any]) -> str:
    found = [records[name] for name in FRAMES if name in records]
    parts = list(found[0]["milliseconds"]) if found else []
    rows = [
        (
            f"{each['strands']:,}",
            f"{each['size']} x {each['size']}",
            *(f"{each['milliseconds'][part]:g}" for part in parts),
            f"{each['peak_gigabytes']:g}",
        )
        for each in found
    ]
    return table(("strands", "pixels", *(part.replace("_", " ") for part in parts), "peak, GB"), rows)


def _step(records: Mapping[str, Any]) -> str:
    rows = [(name.strip(), median) for name, median, _ in STEP.findall(records.get("step", {}).get("output", ""))]
    return table(("part", "ms"), rows)


def _prior(records: Mapping[str, Any]) -> str:
    figures = {name: value for name, value in records.get("prior", {}).items() if name.endswith("_ms")}
    rows = [(name.removesuffix("_ms").replace("_", " "), f"{value:.3g}") for name, value in figures.items()]
    return table(("operation", "ms"), rows)


def _geometry(records: Mapping[str, Any]) -> str:
    scores = records.get("paper_scores", {})
    rows = []
    for what in ("strands", "lmvs"):
        cells = [
            " ".join(f"{scores[what][level][name]:.1f}" for name in ("precision", "recall", "f_score"))
            for level in THRESHOLDS
            if level in scores.get(what, {})
        ]
        if cells:
            rows.append((what, *cells))
    return table(("what", *THRESHOLDS.values()), rows)


def _rivals(records: Mapping[str, Any]) -> str:
    rows = []
    for name, record in records.items():
        if not name.startswith("rival_"):
            continue
        rival = name.removeprefix("rival_")
        if "scores" not in record:
            rows.append((rival, "-", "-", "-", "-", "-", f"skipped: {record.get('skipped', 'no scores')}"))
            continue
        hair = record["scores"]["mean"]["hair"]
        cells = ["-" if hair[key] is None else f"{hair[key]:.4g}" for key in ("psnr", "ssim", "lpips")]
        rows.append((rival, f"{record['iterations']:,}", f"{record['minutes']:.1f}", *cells, ""))
    return table(("rival", "iterations", "minutes", "PSNR", "SSIM", "LPIPS", ""), rows)


def _images(records: Mapping[str, Any]) -> str:
    found = records.get("paper_scores", {}).get("held_out_views")
    if not found:
        return ""
    cells = ["-" if found[name] is None else f"{found[name]:.4g}" for name in ("psnr", "ssim", "lpips")]
    return table(("views", "PSNR", "SSIM", "LPIPS"), [(str(found["count"]), *cells)])
