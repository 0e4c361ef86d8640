"""The demo's photographs, which ship with the package so that nobody has to path-trace them.

They are the pictures that `synthesize` renders, without loss. Each view has two WebP files: the photograph, and the
coverage of hair and of the whole person in the red and the green channel of another.
"""

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image
from torch import Tensor

from neural_strands.capture.writer import CaptureWriter, view_files
from neural_strands.foundation.files import write_json
from neural_strands.geometry.cameras import Camera

SAMPLE = Path(__file__).with_name("sample")
RECORD = "sample.json"
"""What the pictures show: the settings of `synthesize`, and some points of the strands."""
EVERY_STRAND, EVERY_POINT = 200, 33
"""One point in so many is recorded."""
CLOSE = 1e-4
"""Strands at most so far from the recorded points, metres, are those in the pictures: processors round differently."""


def sample_shows(settings: Mapping[str, Any], points: Float[Tensor, "strand point 3"]) -> bool:
    """Whether the shipped pictures are those of a capture.

    Args:
        settings: what `synthesize` records of the capture.
        points: its strands, world metres.
    """
    record = json.loads((SAMPLE / RECORD).read_text(encoding="utf-8"))
    if _without_digests(settings) != record["settings"]:
        return False
    recorded, probes = torch.tensor(record["points"]), _probes(points)
    return recorded.shape == probes.shape and bool((recorded - probes).norm(dim=-1).max() <= CLOSE)


def unpack_sample(writer: CaptureWriter, cameras: Sequence[Camera]) -> None:
    """Write the shipped pictures and masks of some cameras of the capture that they show.

    Raises:
        InputError: a file cannot be written.
    """
    for camera in cameras:
        photograph, masks = (_picture(path) for path in _sample_files(SAMPLE, camera.name))
        writer.write_view(camera, photograph, masks[..., 0], masks[..., 1])


def pack_sample(capture: Path, cameras: Sequence[Camera], points: Float[Tensor, "strand point 3"], out: Path) -> None:
    """Make the files of a sample from a synthetic capture.

    Args:
        capture: folder that `synthesize` wrote.
        cameras: its cameras.
        points: its true strands, world metres.
        out: folder for the sample; what it holds is replaced.
    """
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    for camera in cameras:
        photograph, hair, person = (Image.open(path) for path in view_files(capture, camera))
        masks = Image.merge("RGB", (hair, person, Image.new("L", hair.size)))
        for picture, path in zip((photograph, masks), _sample_files(out, camera.name), strict=True):
            picture.save(path, lossless=True, quality=100, method=6, exact=True)
    settings = json.loads((capture / "synthesis.json").read_text(encoding="utf-8"))
    record = {"settings": _without_digests(settings), "points": np.round(_probes(points).double().numpy(), 6).tolist()}
    write_json(out / RECORD, record)


def _without_digests(settings: Mapping[str, Any]) -> dict[str, Any]:
    kept = {name: value for name, value in settings.items() if not name.endswith("_digest")}
    return json.loads(json.dumps(kept))


def _probes(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "probe 3"]:
    return points[::EVERY_STRAND, ::EVERY_POINT].reshape(-1, 3)


def _sample_files(folder: Path, name: str) -> tuple[Path, Path]:
    stem = Path(name).stem
    return folder / f"{stem}.webp", folder / f"{stem}_masks.webp"


def _picture(path: Path) -> UInt8[np.ndarray, "row column 3"]:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))
