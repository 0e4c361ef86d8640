"""From strands on a head to a capture folder: pictures from a dome of cameras, masks and ground truth."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch

from neural_strands.capture.writer import CaptureWriter, quantised
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.head import Head
from neural_strands.synthesis.backend import load_mitsuba
from neural_strands.synthesis.dome import DomeConfig, dome
from neural_strands.synthesis.path_tracer import PathTracer, TracingConfig
from neural_strands.synthesis.resume import claim_folder, is_rendered
from neural_strands.synthesis.sample import sample_shows, unpack_sample

SMALLEST, LARGEST = 0.02, 3.0
"""Smallest and largest plausible size of a groom (m)."""
FURTHEST_ROOT = 0.03
"""Median distance from root to head (m) beyond which a groom does not belong to the head."""


@dataclass(frozen=True)
class SynthesisConfig:
    """Cameras and quality of a synthetic capture."""

    dome: DomeConfig = field(default_factory=DomeConfig)
    """Where the cameras stand."""
    tracing: TracingConfig = field(default_factory=TracingConfig)
    """How pictures are rendered."""
    seed: int = 0
    """Seed of pigments, textures and noise."""


def synthesize(
    folder: Path,
    head: Head,
    strands: Strands,
    config: SynthesisConfig,
    origin: Mapping[str, str | int],
    overwrite: bool = False,
    shipped: bool = False,
) -> int:
    """Render a capture into `folder` and return how many views were rendered; finished views are kept.

    Args:
        folder: new, empty, or a capture begun with the same settings.
        head: what the hair grows on.
        strands: the hair; world metres.
        config: cameras and quality.
        origin: where the strands come from; stored with the settings and named if they differ.
        overwrite: replace a capture with other settings.
        shipped: take the pictures that ship with the package instead of rendering them, if they show this capture.

    Raises:
        InputError: strands and head do not go together, the folder holds another capture, or Mitsuba is missing.
    """
    check_fit(head, strands)
    strands = quantised(strands)
    cameras = dome(strands.points.reshape(-1, 3), config.dome)
    digests = {"strands_digest": _digest(strands.points), "head_digest": _digest(head.mesh.vertices)}
    settings = {**origin, **asdict(config.dome), **asdict(config.tracing), "seed": config.seed, **digests}
    unpacked = shipped and sample_shows(settings, strands.points)
    if not unpacked:
        # Without Mitsuba, nothing should be left behind.
        load_mitsuba()
    claim_folder(folder, settings, overwrite)
    writer = CaptureWriter(folder)
    missing = [camera for camera in cameras if not is_rendered(folder, camera)]
    if missing:
        writer.write_head(head.mesh, head.scalp_faces)
        writer.write_ground_truth(strands)
    if unpacked:
        unpack_sample(writer, missing)
    elif missing:
        generator = torch.Generator().manual_seed(config.seed)
        tracer = PathTracer(head, strands, config.tracing, generator)
        for camera in track(missing, "path tracing"):
            noise = config.seed * len(cameras) + int(camera.name)
            image = tracer.image(camera, noise)
            writer.write_view(camera, image, *tracer.coverage(camera).unbind(dim=-1))
    writer.finish(cameras)
    return 0 if unpacked else len(missing)


def check_fit(head: Head, strands: Strands) -> None:
    """Reject grooms that cannot be in metres or do not grow on this head.

    Raises:
        InputError: the groom is smaller or larger than hair, or its roots are far from the head.
    """
    extent = float((strands.points.amax(dim=(0, 1)) - strands.points.amin(dim=(0, 1))).max())
    if not SMALLEST <= extent <= LARGEST:
        raise InputError(
            f"groom: expected hair of {SMALLEST} to {LARGEST:g} m, but this one measures {extent:.4g} m; bring it to "
            "metres with `neural-strands convert --scale`."
        )
    away = float(closest_points(strands.points[:, 0], head.mesh).distance.median())
    if away > FURTHEST_ROOT:
        raise InputError(
            f"groom: expected roots on the head, but half of them are more than {away:.3f} m away from it; bring both "
            "to the same place, y up and +z out of the face (`neural-strands convert --scale --up --front`)."
        )


def _digest(tensor: torch.Tensor) -> str:
    return hashlib.sha256(tensor.detach().cpu().contiguous().numpy().tobytes()).hexdigest()[:16]
