"""Mesh files with their faces in file order, so that lists of faces and charts by loop keep their meaning."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh

HELPER_GROUPS = ("helper", "joint")
"""Prefixes of groups that are no skin: MakeHuman's base mesh carries clothes proxies and joint cubes."""


@dataclass(frozen=True)
class MeshFile:
    """A mesh as its file has it, polygons cut into triangles.

    Attributes:
        mesh: triangles in the file's unit.
        polygon: (face,) the polygon of each triangle, counted in file order.
        loops: (face, 3) the running count of corners over all polygons, for each triangle's corners.
        polygons: number of polygons in the file, those left out included.
    """

    mesh: Mesh
    polygon: np.ndarray
    loops: np.ndarray
    polygons: int


def read_mesh_file(path: Path) -> MeshFile:
    """Read OBJ, or anything else that trimesh reads, without merging or reordering.

    Raises:
        InputError: the file is absent, unreadable, has no faces, or names vertices it does not have.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a mesh file, found none there; check the path.")
    result = _read_obj(path) if path.suffix.lower() == ".obj" else _read_other(path)
    if len(result.mesh.faces) == 0:
        raise InputError(f"{path}: expected a mesh with faces, found none; export the head as a surface.")
    if not torch.isfinite(result.mesh.vertices).all():
        raise InputError(f"{path}: expected finite vertices, found NaN or infinity; repair the mesh.")
    highest = int(result.mesh.faces.max())
    if highest >= len(result.mesh.vertices) or int(result.mesh.faces.min()) < 0:
        raise InputError(
            f"{path}: expected vertex numbers up to {len(result.mesh.vertices)}, found {highest + 1}: is it cut off?"
        )
    return result


def _read_obj(path: Path) -> MeshFile:
    vertices: list[list[float]] = []
    textures: list[list[float]] = []
    polygons: list[list[str]] = []
    kept: list[bool] = []
    skin = True
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            words = line.split()
            if not words:
                continue
            try:
                if words[0] == "v":
                    vertices.append([float(word) for word in words[1:4]])
                elif words[0] == "vt":
                    textures.append([float(word) for word in words[1:3]])
                elif words[0] == "g":
                    skin = not " ".join(words[1:]).startswith(HELPER_GROUPS)
                elif words[0] == "f":
                    polygons.append(words[1:])
                    kept.append(skin)
            except ValueError as error:
                raise InputError(f"{path}: line {number}: expected numbers, found {line.strip()!r}.") from error
    try:
        return _cut(vertices, textures, polygons, np.array(kept, dtype=bool))
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}: expected faces of existing vertices and texture points ({error}).") from error


def _cut(
    vertices: list[list[float]], textures: list[list[float]], polygons: list[list[str]], kept: np.ndarray
) -> MeshFile:
    """Triangulate polygons as fans from their first corner."""
    sizes = np.array([len(polygon) for polygon in polygons], dtype=np.int64)
    if (sizes < 3).any():
        raise ValueError("a face with fewer than three corners")
    words = [word.split("/") for polygon in polygons for word in polygon]
    corner = _resolve(np.array([int(word[0]) for word in words], dtype=np.int64), len(vertices))
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    triangles_each = np.where(kept, sizes - 2, 0)
    polygon = np.repeat(np.arange(len(sizes)), triangles_each)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles_each) - triangles_each, triangles_each)
    start = first[polygon]
    loops = np.stack([start, start + step + 1, start + step + 2], axis=1)
    corner_uv = None
    if textures and all(len(word) > 1 and word[1] for word in words):
        texture = _resolve(np.array([int(word[1]) for word in words], dtype=np.int64), len(textures))
        corner_uv = torch.tensor(textures, dtype=torch.float32)[torch.from_numpy(texture[loops])]
    positions = torch.tensor(vertices, dtype=torch.float32).reshape(-1, 3)
    return MeshFile(Mesh(positions, torch.from_numpy(corner[loops]), corner_uv), polygon, loops, len(sizes))


def _resolve(index: np.ndarray, count: int) -> np.ndarray:
    """OBJ counts from one, negative numbers from the end."""
    return np.where(index < 0, index + count, index - 1)


def _read_other(path: Path) -> MeshFile:
    import trimesh

    try:
        loaded = trimesh.load(path, process=False, force="mesh")
    except Exception as error:
        raise InputError(
            f"{path}: expected a mesh that trimesh reads, such as .obj, .ply, .stl or .glb ({error})."
        ) from error
    if not isinstance(loaded, trimesh.Trimesh):
        raise InputError(f"{path}: expected a triangle mesh, found {type(loaded).__name__}.")
    faces = torch.from_numpy(np.asarray(loaded.faces, dtype=np.int64).reshape(-1, 3).copy())
    uv = getattr(loaded.visual, "uv", None)
    corner_uv = None if uv is None else torch.from_numpy(np.asarray(uv, dtype=np.float32))[faces]
    vertices = torch.from_numpy(np.asarray(loaded.vertices, dtype=np.float32).copy())
    count = len(faces)
    return MeshFile(Mesh(vertices, faces, corner_uv), np.arange(count), np.arange(3 * count).reshape(-1, 3), count)
