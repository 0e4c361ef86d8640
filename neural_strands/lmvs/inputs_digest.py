"""A digest of everything that per-view results depend on; stored results are reused only while it stays the same."""

import hashlib
from collections.abc import Iterable, Sequence

import numpy as np
from torch import Tensor

from neural_strands import __version__
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import Views


def inputs_digest(views: Views, head: Mesh | None, settings: Iterable[object]) -> str:
    """Digest of photographs, masks, cameras, head, settings and this program's version.

    Args:
        views: the views; photographs are read one at a time.
        head: the head, if it is known.
        settings: everything else that affects results, distinguishable by its `repr`.
    """
    digest = hashlib.sha256(repr([__version__, views.witnesses, *settings]).encode())
    for index, camera in enumerate(views.cameras):
        digest.update(repr((camera.name, camera.width, camera.height)).encode())
        arrays = [camera.intrinsics, camera.world_to_camera, views.image(index)]
        mask = views.hair_mask(index)
        _add(digest, arrays if mask is None else [*arrays, mask])
    if head is not None:
        _add(digest, [head.vertices, head.faces])
    return digest.hexdigest()


def _add(digest: "hashlib._Hash", tensors: Sequence[Tensor]) -> None:
    """Add the shapes and values of tensors to a digest."""
    for tensor in tensors:
        digest.update(repr(tuple(tensor.shape)).encode())
        digest.update(np.ascontiguousarray(tensor.detach().cpu().numpy()).data)
