"""What may lie beside the photographs: the fitted head, the faces that grow hair, and the true strands."""

import json
import zipfile
from pathlib import Path

import numpy as np
import torch
import trimesh
from jaxtyping import Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands


def read_head(path: Path) -> Mesh:
    """Read a head mesh: OBJ with its faces in file order (polygons as fans), or any format that trimesh reads.

    Raises:
        InputError: the file is no mesh of triangles in finite metres.
    """
    try:
        mesh = _read_obj(path) if path.suffix.lower() == ".obj" else _read_other(path)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{path}: expected a triangle mesh, but it does not read as one ({error}).") from error
    count = len(mesh.vertices)
    if count == 0 or len(mesh.faces) == 0:
        raise InputError(f"{path}: expected a triangle mesh, came {count} vertices and {len(mesh.faces)} faces.")
    if mesh.faces.min() < 0 or mesh.faces.max() >= count or not torch.isfinite(mesh.vertices).all():
        raise InputError(f"{path}: expected faces over {count} finite vertices, came an index or a number beyond them.")
    return mesh


def read_scalp_faces(path: Path) -> Int64[Tensor, " scalp"]:
    """Read `scalp_faces.json`: a list of 0-based faces of the head that hair grows from.

    Raises:
        InputError: the file is not a list of whole numbers.
    """
    try:
        faces = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected a JSON list of face numbers, but it cannot be read ({error}).") from error
    whole = isinstance(faces, list) and all(type(face) is int and face >= 0 for face in faces)
    if not whole or not faces:
        raise InputError(f"{path}: expected a non-empty JSON list of 0-based face numbers, came something else.")
    return torch.tensor(faces, dtype=torch.int64)


def read_ground_truth(path: Path) -> Strands:
    """Read `ground_truth.npz`: `strands` (strand, point, 3), root first, times `unit` metres (1 where absent).

    Raises:
        InputError: an array is missing, has another shape, or holds numbers that are not finite.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            stored = archive["strands"]
            unit = float(archive["unit"]) if "unit" in archive.files else 1.0
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: expected an npz with 'strands' and 'unit', but it does not read so ({error})."
        ) from error
    if stored.ndim != 3 or stored.shape[2] != 3 or stored.shape[1] < 2 or stored.dtype.kind not in "if":
        raise InputError(f"{path}: expected 'strands' of shape (strand, point, 3), came {stored.shape} {stored.dtype}.")
    points = torch.from_numpy((stored * np.float64(unit)).astype(np.float32))
    if not torch.isfinite(points).all():
        raise InputError(f"{path}: expected finite strands, came numbers that are not finite.")
    return Strands(points)


def _read_other(path: Path) -> Mesh:
    mesh = trimesh.load_mesh(path, process=False)
    if not isinstance(mesh, trimesh.Trimesh):
        raise InputError(f"{path}: expected one triangle mesh, came {type(mesh).__name__}.")
    vertices = np.asarray(mesh.vertices, dtype=np.float32)
    return Mesh(torch.from_numpy(vertices), torch.from_numpy(np.asarray(mesh.faces, dtype=np.int64)))


def _read_obj(path: Path) -> Mesh:
    """Vertices, faces and, where every corner has one, texture coordinates of a Wavefront OBJ."""
    vertices: list[list[float]] = []
    coordinates: list[list[float]] = []
    corners: list[list[tuple[int, int]]] = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            vertices.append([float(word) for word in words[1:4]])
        elif words[0] == "vt":
            coordinates.append([float(word) for word in words[1:3]])
        elif words[0] == "f":
            polygon = [_corner(word, len(vertices), len(coordinates)) for word in words[1:]]
            corners += [[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)]
    index = torch.tensor(corners, dtype=torch.int64).reshape(-1, 3, 2)
    textured = bool(coordinates) and bool((index[..., 1] >= 0).all()) and int(index[..., 1].max()) < len(coordinates)
    corner_uv = torch.tensor(coordinates, dtype=torch.float32)[index[..., 1]] if textured else None
    return Mesh(torch.tensor(vertices, dtype=torch.float32).reshape(-1, 3), index[..., 0].contiguous(), corner_uv)


def _corner(word: str, vertex_count: int, coordinate_count: int) -> tuple[int, int]:
    """Vertex and texture index of `v`, `v/t`, `v//n` or `v/t/n`; negative indices count from the end; -1 for none."""
    parts = word.split("/")
    vertex = int(parts[0])
    texture = int(parts[1]) if len(parts) > 1 and parts[1] else 0
    resolved = texture - 1 if texture > 0 else coordinate_count + texture
    return (vertex - 1 if vertex > 0 else vertex_count + vertex), (-1 if texture == 0 else resolved)
