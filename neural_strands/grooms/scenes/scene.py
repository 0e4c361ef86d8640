"""Exports strands, guides and motion to any format that can store them."""

from dataclasses import dataclass
from pathlib import Path

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.grooms.checks import check_writable
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import WRITERS, write_groom
from neural_strands.grooms.motion import Motion
from neural_strands.grooms.scenes.alembic import Blender, write_alembic
from neural_strands.grooms.scenes.gltf import write_glb
from neural_strands.grooms.usd import write_usd

WITH_MOTION = (".usd", ".usda", ".usdc", ".abc")
"""Formats that can store guides and motion."""
SUFFIXES = (".usd", ".usda", ".usdc", ".abc", ".glb", *(name for name in WRITERS if not name.startswith(".usd")))
"""Formats that can be exported."""


@dataclass(frozen=True)
class Scene:
    """A groom to export, in metres, y up, +z out of the face.

    Attributes:
        strands: all strands.
        guides: some of them, each representing those around it.
        motion: positions of the strands' points over time.
    """

    strands: Groom
    guides: Groom | None = None
    motion: Motion | None = None


def check_scene_path(path: Path, moves: bool = False) -> None:
    """Refuse a file name without a suitable format, before any work is done.

    Args:
        path: the file.
        moves: whether the format must store motion.

    Raises:
        InputError: the suffix is not one of the suitable formats, which the message lists.
    """
    fitting, what = (WITH_MOTION, "a format that holds motion") if moves else (SUFFIXES, "a groom")
    if path.suffix.lower() not in fitting:
        found = path.suffix or "no suffix"
        raise InputError(f"{path}: expected {what} with one of {', '.join(fitting)}, found {found}; choose one.")


def write_scene(path: Path, scene: Scene, blender: Blender) -> None:
    """Write a scene atomically; formats that cannot store guides and motion omit them.

    Args:
        path: the file; its suffix chooses the format.
        scene: the scene to write.
        blender: the Blender that writes `.abc` without alembic3d.

    Raises:
        InputError: the suffix is unknown, Blender is needed and missing, the strands have values that no reader
            accepts, or the file cannot be written.
    """
    check_scene_path(path)
    suffix = path.suffix.lower()
    if suffix in WRITERS and suffix not in WITH_MOTION:
        write_groom(path, scene.strands)
        return
    check_writable(path, scene.strands)
    with atomic_file(path) as temporary:
        if suffix == ".glb":
            write_glb(temporary, scene.strands)
        elif suffix == ".abc":
            write_alembic(temporary, scene.strands, scene.guides, scene.motion, blender)
        else:
            write_usd(temporary, scene.strands, scene.guides, scene.motion)
