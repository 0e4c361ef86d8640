"""The folder of a fit: its paths, and whether it belongs to this capture and these settings."""

import dataclasses
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neural_strands import __version__
from neural_strands.capture.capture import Capture
from neural_strands.fitting.config import FitConfig
from neural_strands.foundation.configs import config_from_json
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.foundation.json_files import check_format, read_json
from neural_strands.model.files import MODEL_NAME
from neural_strands.prior.vae import StrandPrior
from neural_strands.scalp.head import Head

FORMAT = 3
"""Version of `run.json`; a checkpoint of another one is not continued, because the networks see something else."""
LONGEST_PATH = 4096
"""Longest path that operating systems accept, characters."""


@dataclass(frozen=True)
class RunFolder:
    """Paths inside one run.

    Attributes:
        path: the folder, `RUN`.
    """

    path: Path

    @property
    def description(self) -> Path:
        """Settings and capture of the run."""
        return self.path / "run.json"

    @property
    def segments(self) -> Path:
        """Line segments that the fit used."""
        return self.path / "segments.npz"

    @property
    def checkpoint(self) -> Path:
        """The state from which the fit resumes."""
        return self.path / "checkpoint.pt"

    @property
    def log(self) -> Path:
        """One JSON object per step."""
        return self.path / "log.jsonl"

    @property
    def model(self) -> Path:
        """The hair model that renders."""
        return self.path / MODEL_NAME

    @property
    def groom(self) -> Path:
        """The strands, for Blender and other programs."""
        return self.path / "groom.usd"

    @property
    def groom_arrays(self) -> Path:
        """The strands, for Python: points, root uv, colour."""
        return self.path / "groom.npz"

    @property
    def preview(self) -> Path:
        """A training view as currently rendered, beside its photograph."""
        return self.path / "preview.png"

    @property
    def report(self) -> Path:
        """Folder of the report that `evaluate` writes."""
        return self.path / "report"


@dataclass(frozen=True)
class RunDescription:
    """Contents of `run.json`.

    Attributes:
        capture: folder of the capture, absolute.
        head: head file that was given, absolute, or empty.
        fingerprint: digest of the capture's cameras, images and masks, and of the head.
        config: complete settings.
        prior: digest of the strand generator's weights, which are not part of checkpoints.
        folder: the run's own folder, absolute, to find capture and head after everything was moved; empty in older
            runs.
    """

    capture: str
    head: str
    fingerprint: str
    config: FitConfig
    prior: str
    folder: str = ""


def write_description(folder: RunFolder, description: RunDescription) -> None:
    """Write the description of a run.

    Raises:
        InputError: the folder cannot be written.
    """
    plain = {"format": FORMAT, "version": __version__, **dataclasses.asdict(description)}
    with atomic_file(folder.description) as temporary:
        temporary.write_text(json.dumps(plain, indent=2) + "\n", encoding="utf-8")


def read_description(folder: RunFolder) -> RunDescription:
    """Read the description of a run.

    Raises:
        InputError: there is no run in the folder, or its description is damaged.
    """
    path = folder.description
    if not path.is_file():
        raise InputError(f"{folder.path}: expected the folder of a fit, found no {path.name}; run `fit` first.")
    written = read_json(path, "the description of a fit", "restore it, or fit into a new folder")
    check_format(written, FORMAT)
    config = config_from_json(FitConfig, written.member("config"))
    names = ("capture", "head", "fingerprint", "prior")
    capture, head, fingerprint, prior = (written.member(name).text(LONGEST_PATH) for name in names)
    place = written.optional("folder")
    return RunDescription(capture, head, fingerprint, config, prior, "" if place is None else place.text(LONGEST_PATH))


def found_again(folder: RunFolder, described: RunDescription, path: str) -> Path:
    """Find a path of a run's description now: unchanged, or else at the same place relative to the run.

    Args:
        folder: the run's present folder.
        described: contents of `run.json`.
        path: `capture` or `head` from the description.
    """
    return place_now(folder.path, described.folder, path)


def place_now(folder: Path, before: str, path: str) -> Path:
    """Find a path of a folder's description now: unchanged, or else at the same place relative to the folder.

    Args:
        folder: the present folder.
        before: absolute path of the folder when it was described; empty if unknown.
        path: absolute, as described.
    """
    moved = folder / os.path.relpath(path, before) if before else Path(path)
    return moved if moved.exists() and not Path(path).exists() else Path(path)


def check_same(folder: RunFolder, wanted: RunDescription) -> None:
    """Reject another capture or other settings than those with which the run started.

    Raises:
        InputError: something differs; the message names the first difference.
    """
    stored = read_description(folder)
    if stored.fingerprint != wanted.fingerprint:
        raise InputError(
            f"{folder.path}: the capture {wanted.capture} has changed since this run began (cameras, images, masks or "
            "head); restore it, or fit into a new folder."
        )
    if stored.prior != wanted.prior:
        raise InputError(
            f"{folder.path}: this run began with other weights of the strand prior; "
            "give those with --prior, or fit into a new folder."
        )
    if stored.config != wanted.config:
        ours, theirs = dataclasses.asdict(wanted.config), dataclasses.asdict(stored.config)
        name, theirs, ours = _first_difference(theirs, ours)
        raise InputError(
            f"{folder.path}: this run began with {name} = {theirs}, found {ours}; "
            "give the settings it began with, or fit into a new folder."
        )


def _first_difference(theirs: Any, ours: Any) -> tuple[str, Any, Any]:
    """The first setting in which two nested mappings of the same names differ: its dotted name and both values."""
    names: list[str] = []
    while isinstance(ours, dict):
        names.append(next(name for name in ours if ours[name] != theirs[name]))
        theirs, ours = theirs[names[-1]], ours[names[-1]]
    return ".".join(names), theirs, ours


def weights_digest(prior: StrandPrior) -> str:
    """Digest of the strand generator's weights."""
    digest = hashlib.sha256()
    for name, value in sorted(prior.generator.state_dict().items()):
        digest.update(name.encode())
        digest.update(value.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def fingerprint(capture: Capture, head: Head) -> str:
    """Digest of the cameras, of the files of every image and mask, and of the head; no image is decoded."""
    digest = hashlib.sha256()
    for view in capture.files:
        camera = view.camera
        digest.update(f"{camera.name} {camera.width} {camera.height}".encode())
        digest.update(camera.intrinsics.double().numpy().tobytes())
        digest.update(camera.world_to_camera.double().numpy().tobytes())
        for path in (view.image_path, view.hair_mask_path, view.person_mask_path):
            if path is not None and path.is_file():
                with path.open("rb") as file:
                    digest.update(hashlib.file_digest(file, "sha256").digest())
    for tensor in (head.mesh.vertices, head.mesh.faces, head.scalp_faces):
        digest.update(tensor.cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()
