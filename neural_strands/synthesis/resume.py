"""Resumes a stopped synthesis, but only in a folder that was started with the same settings.

synthesis.json is written first and records the settings.
"""

import json
import shutil
from pathlib import Path
from typing import Any

from neural_strands.capture.writer import HAIR_MASKS, IMAGES, PERSON_MASKS, view_files
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import is_taken, write_json
from neural_strands.foundation.json_files import read_json
from neural_strands.geometry.cameras import Camera

SETTINGS = "synthesis.json"
"""The record of how a capture was made."""


def claim_folder(folder: Path, settings: dict[str, Any], overwrite: bool = False) -> None:
    """Claim a folder for these settings, or continue in it if it was started with the same settings.

    With `overwrite`, a capture with other settings is removed first; a folder with anything else is never removed.

    Raises:
        InputError: the folder has other contents, or a capture with other settings.
    """
    record = folder / SETTINGS
    settings = json.loads(json.dumps(settings))
    if not record.exists():
        if is_taken(folder):
            raise InputError(
                f"{folder}: expected a new or empty folder, or a capture begun by synthesize, but it holds something "
                "else; name another folder."
            )
        write_json(record, settings)
        return
    members = read_json(record, "the settings of an earlier run", "remove the folder, or name another one").members()
    earlier = {name: member.value for name, member in members.items()}
    changed = differences(earlier, settings)
    if changed and overwrite:
        _clear(folder)
        write_json(record, settings)
    elif changed:
        raise InputError(
            f"{folder}: holds a capture with other settings ({'; '.join(changed)}); repeat those, name another folder, "
            "or pass --overwrite."
        )


def is_rendered(folder: Path, camera: Camera) -> bool:
    """Whether the picture and both masks of a camera exist."""
    return all(path.is_file() for path in view_files(folder, camera))


def differences(earlier: dict[str, Any], later: dict[str, Any]) -> list[str]:
    """Differences between two settings, each as "name: A there, B now"; digests only if nothing else differs."""
    names = [name for name in {**earlier, **later} if earlier.get(name) != later.get(name)]
    names = [name for name in names if not name.endswith("_digest")] or names
    return [f"{name}: {earlier.get(name)} there, {later.get(name)} now" for name in names]


def _clear(folder: Path) -> None:
    """Remove the files of an earlier capture, its settings last, so that an interrupted removal can be repeated."""
    for name in (IMAGES, HAIR_MASKS, PERSON_MASKS):
        shutil.rmtree(folder / name, ignore_errors=True)
    for name in ("transforms.json", "head.obj", "scalp_faces.json", "ground_truth.npz", SETTINGS):
        (folder / name).unlink(missing_ok=True)
