"""Files of subjects for tests: tiny captures with known segments, and settings of a few steps."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.lmvs.files import save_segments


def in_toml(value: object) -> str:
    """A value as TOML writes it on one line."""
    if isinstance(value, dict):
        pairs = (f"{json.dumps(name)} = {in_toml(each)}" for name, each in value.items() if each is not None)
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(in_toml, value)) + "]"
    return json.dumps(value)


def write_subjects(path: Path, tables: Mapping[str, Mapping[str, object]], **config: object) -> Path:
    """A file of subjects that are fitted with tiny settings, with one core per task."""
    demand = {"cores": 1, "memory": 0.5}
    lines = [f"defaults.config = {in_toml(asdict(tiny_config(**config)))}"]
    lines += [f"resources.{stage} = {in_toml(demand)}" for stage in ("prepare", "lmvs", "fit", "evaluate")]
    lines += [
        f"[subjects.{name}]\n" + "".join(f"{k} = {in_toml(v)}\n" for k, v in t.items()) for name, t in tables.items()
    ]
    path.write_text("\n".join(lines))
    return path


def write_ball(folder: Path) -> dict[str, object]:
    """A capture and its segments; what a table says of a subject that has them."""
    save_segments(folder / "segments.npz", true_segments(write_capture(folder / "ball", views=4)))
    return {"capture": str(folder / "ball"), "segments": str(folder / "segments.npz")}
