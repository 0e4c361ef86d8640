"""`.abc` files (Alembic), through the module `alembic3d` or through Blender in a separate process; write-only.

`alembic3d`, the extra `alembic`, writes everything that Unreal reads (`unreal_alembic.py`). If it is missing, or a
Blender is given, Blender's module `bpy` writes the file. `bpy` is large, needs one particular version of Python and is
under the GPL, so it may be installed in another environment, in which `alembic_worker.py` runs.

Blender stores points (y up, metres), widths and motion of strands and guides. Both objects have the custom properties
`groom_group_id` (0) and `groom_guide` (0 or 1). Blender's exporter does not write attributes per curve, so root uv,
colours and the unseen share are lost.
"""

import importlib.util
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.worker import started_worker
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.motion import Motion
from neural_strands.grooms.scenes.unreal_alembic import is_available, write_unreal_alembic

WORKER = Path(__file__).with_name("alembic_worker.py")
ADVICE = (
    "install it (`pip install neural-strands[blender]`), or name a Python that has it with --blender "
    "(`python3.11 -m venv blender && blender/bin/pip install bpy`)"
)


@dataclass(frozen=True)
class Blender:
    """Which Blender to use.

    Attributes:
        python: an interpreter that has the module `bpy`; this one if None.
    """

    python: Path | None = None

    def check(self) -> None:
        """Check that Alembic can be written, before anything is computed.

        Raises:
            InputError: the interpreter does not exist, or this one has neither `alembic3d` nor `bpy`.
        """
        if self.python is not None and not self.python.is_file():
            raise InputError(f"{self.python}: expected a Python with Blender's module bpy, found no file; {ADVICE}.")
        if self.python is None and not is_available() and importlib.util.find_spec("bpy") is None:
            raise InputError(
                "Writing .abc: expected the module alembic3d or Blender's module bpy, found neither; install the first "
                f"(`pip install neural-strands[alembic]`), or Blender: {ADVICE}."
            )

    def run(self, worker: Path, request: dict) -> None:
        """Run a worker on a request.

        Raises:
            InputError: Blender is missing, or failed.
        """
        self.check()
        with started_worker(self.python, worker, request, "bpy") as running:
            if running.status():
                said = running.last_words()
                raise InputError(f"{running.python}: expected Blender to work, found: {said}; {ADVICE}.")


def write_alembic(path: Path, groom: Groom, guides: Groom | None, motion: Motion | None, blender: Blender) -> None:
    """Write strands and guides.

    Raises:
        InputError: there is neither alembic3d nor Blender, or Blender failed.
    """
    if blender.python is None and is_available():
        write_unreal_alembic(path, groom, guides, motion)
        return
    with TemporaryDirectory() as folder:
        place = Path(folder)
        objects = []
        for name, part in (("strands", groom), ("guides", guides)):
            if part is None:
                continue
            arrays = {"vertices": part.vertices, "sizes": part.sizes, "width": part.width}
            present = {key: value.cpu().numpy() for key, value in arrays.items() if value is not None}
            np.savez(place / f"{name}.npz", allow_pickle=False, **present)
            objects.append({"name": name, "arrays": str(place / f"{name}.npz"), "guide": int(name == "guides")})
        if motion is not None:
            shape = (motion.frames, *groom.vertices.shape)
            frames = np.lib.format.open_memmap(place / "frames.npy", "w+", np.float32, shape)
            for frame in range(motion.frames):
                frames[frame] = motion.vertices(frame).cpu().numpy()
            frames.flush()
            objects[0].update(frames=str(place / "frames.npy"), fps=motion.fps)
        blender.run(WORKER, {"out": str(path.absolute()), "objects": objects})
