"""Per-view results, kept on disk between stages so that memory does not grow with the number of views."""

import logging
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.geometry.views import Views
from neural_strands.lmvs.features import Features, view_features
from neural_strands.lmvs.orientation import OrientationConfig
from neural_strands.lmvs.patchmatch import LineMap

log = logging.getLogger(__name__)

KEPT = 12
"""Number of views kept in memory: a reference, its eight neighbours, and some that the next reference shares."""
LEAST_CONFIDENCE = 0.02
"""A view whose hair has a lower mean confidence of orientation is skipped."""
LEAST_HAIR = 64
"""A view with fewer pixels of hair is skipped."""
FEATURES = (
    ArraySpec("texture", "height width 4", finite=False),
    ArraySpec("hair", "height width", kinds="b"),
    ArraySpec("silhouette", "height width", kinds="b"),
)
LINES = (
    ArraySpec("pixel", "point 2", np.int64, kinds="i"),
    ArraySpec("depth", "point", np.float32, finite=False),
    ArraySpec("direction", "point 3", np.float32, finite=False),
    ArraySpec("cost", "point", np.float32, finite=False),
)
"""Arrays of the files, named like the fields of `Features` and `LineMap`."""


class ViewCache:
    """Per-view results in a folder, the latest few in memory."""

    def __init__(self, folder: Path, views: Views, config: OrientationConfig) -> None:
        """Store results in `folder`; those already in it are reused (see `keep_only`)."""
        self.folder, self.views, self.config = folder, views, config
        self._features: OrderedDict[int, Features] = OrderedDict()
        self._lines: OrderedDict[int, LineMap] = OrderedDict()

    def keep_only(self, digest: str) -> None:
        """Keep the stored results if they were made from the same inputs; otherwise remove them and log it."""
        path = self.folder / "inputs.txt"
        if path.is_file() and path.read_bytes() == digest.encode():
            return
        stale = [*self.folder.glob("features_*.npz"), *self.folder.glob("lines_*.npz")]
        if stale:
            log.warning("%s: made of other photographs or settings; every view is computed again.", self.folder)
        for old in stale:
            old.unlink()
        with atomic_file(path) as temporary:
            temporary.write_text(digest)

    def prepare(self, index: int) -> bool:
        """Compute and store a view's features; returns False, with a warning, if it shows no hair."""
        features = self.features(index)
        fault = None
        if int(features.hair.sum()) < LEAST_HAIR:
            fault = "no hair found in this view"
        elif float(features.texture[features.hair][:, 2].mean()) < LEAST_CONFIDENCE:
            fault = "no texture where the hair should be (a black, saturated or empty image)"
        if fault is not None:
            log.warning("%s: %s; the view is left out.", self.views.cameras[index].name or f"view {index}", fault)
        return fault is None

    def features(self, index: int) -> Features:
        """A view's features, from memory, from disk, or computed."""
        if index not in self._features:
            path = self._path(index, "features")
            if path.is_file():
                arrays = self._read(index, path, FEATURES)
                camera, texture = self.views.cameras[index], arrays["texture"].float()
                if texture.shape[:2] != (camera.height, camera.width):
                    raise InputError(
                        f"{path}: expected features of {camera.width} x {camera.height} pixels, found "
                        f"{texture.shape[1]} x {texture.shape[0]}; remove the file, so that the view is computed again."
                    )
                features = Features(camera, texture, arrays["hair"], arrays["silhouette"])
            else:
                mask = self.views.hair_mask(index)
                found, _ = view_features(self.views.cameras[index], self.views.image(index), mask, self.config)
                stored = found.texture.half()
                # Rounded as stored: a stopped run, which reads the file, must continue with the same bits.
                features = replace(found, texture=stored.float())
                with atomic_file(path) as temporary:
                    np.savez(
                        temporary,
                        texture=stored.cpu().numpy(),
                        hair=features.hair.cpu().numpy(),
                        silhouette=features.silhouette.cpu().numpy(),
                    )
            self._features[index] = features
        self._features.move_to_end(index)
        while len(self._features) > KEPT:
            self._features.popitem(last=False)
        return self._features[index]

    def has_lines(self, index: int) -> bool:
        """Whether a view's lines are stored."""
        return self._path(index, "lines").is_file()

    def save_lines(self, index: int, lines: LineMap) -> None:
        """Store a view's lines."""
        with atomic_file(self._path(index, "lines")) as temporary:
            np.savez(temporary, **{name: getattr(lines, name).cpu().numpy() for name in LineMap.__annotations__})
        self._lines[index] = lines

    def lines(self, index: int) -> LineMap:
        """A view's lines, from memory or disk."""
        if index not in self._lines:
            self._lines[index] = LineMap(**self._read(index, self._path(index, "lines"), LINES))
        self._lines.move_to_end(index)
        while len(self._lines) > KEPT:
            self._lines.popitem(last=False)
        return self._lines[index]

    def _read(self, index: int, path: Path, specs: tuple[ArraySpec, ...]) -> dict[str, Tensor]:
        """The arrays of a view's file, on the view's device."""
        arrays = read_npz(path, "results of a view", specs, "remove the file, so that the view is computed again")
        return {name: torch.from_numpy(array).to(self._device(index)) for name, array in arrays.items()}

    def _device(self, index: int) -> torch.device:
        """Device on which a view is processed."""
        return self.views.cameras[index].intrinsics.device

    def _path(self, index: int, kind: str) -> Path:
        name = self.views.cameras[index].name or f"{index:04d}"
        safe = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)
        return self.folder / f"{kind}_{index:04d}_{safe}.npz"
