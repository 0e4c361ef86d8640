"""Mesh files with their faces in file order, so that lists of faces and charts by loop keep their meaning.

A face is a polygon of the file, counted from 0 in file order. Polygons are cut into fans of triangles from their first
corner; `MeshFile.polygon` maps a triangle back to its face.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import torch

from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.foundation.input_files import check_file, read_bytes
from neural_strands.geometry.mesh import Mesh, face_areas

HELPER_GROUPS = ("helper", "joint")
"""Prefixes of groups that are not skin: MakeHuman's base mesh contains clothes proxies and joint cubes."""
FORMATS = (".obj", ".ply", ".stl", ".glb")
"""Formats whose faces can be counted as in the file."""
LARGEST = 1e9
"""Coordinates and indices beyond this are garbage in any unit."""
PLY_TEXTURE_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
"""Names that exporters give to the texture coordinates of a PLY's vertices."""


@dataclass(frozen=True)
class MeshFile:
    """A mesh as in its file, with polygons cut into triangles.

    Attributes:
        mesh: triangles in the file's unit.
        polygon: (face,) the polygon of each triangle, counted in file order.
        loops: (face, 3) the running count of corners over all polygons, for each triangle's corners.
        polygons: number of polygons in the file, including skipped ones.
    """

    mesh: Mesh
    polygon: np.ndarray
    loops: np.ndarray
    polygons: int


@dataclass(frozen=True)
class _Polygons:
    """The polygons that a reader found in a file.

    Attributes:
        vertices: (vertex, 3) positions.
        sizes: (polygon,) corners of each polygon.
        corners: (corner,) vertex of every corner of every polygon.
        uv: (corner, 2) texture coordinates, if every corner has them.
        kept: (polygon,) false for polygons that are not skin.
    """

    vertices: np.ndarray
    sizes: np.ndarray
    corners: np.ndarray
    uv: np.ndarray | None
    kept: np.ndarray


def read_mesh_file(path: Path) -> MeshFile:
    """Read an OBJ, PLY, STL or GLB file without reordering its faces.

    Raises:
        InputError: the file is missing or unreadable, has no surface, or refers to vertices that it does not have.
    """
    check_file(path, "a mesh file")
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise InputError(
            f"{path}: expected a mesh in one of the formats {', '.join(FORMATS)}, found '{suffix}'; convert it."
        )
    try:
        found = _read_obj(path) if suffix == ".obj" else _read_with_trimesh(path)
    except OSError as error:
        raise InputError(f"{path}: expected a mesh file, but it cannot be read ({reason(error)}).") from error
    _check(path, found)
    return _fans(path, found)


def _check(path: Path, found: _Polygons) -> None:
    """Refuse polygons that do not form a mesh.

    Raises:
        InputError: there are no faces, or vertices or indices are invalid.
    """
    if not found.kept.any():
        raise InputError(f"{path}: expected a mesh with faces, found none; export it as a surface.")
    if not (np.abs(found.vertices) < LARGEST).all():
        raise InputError(f"{path}: expected finite vertices, found NaN, infinity or more than 1e9; repair the mesh.")
    if found.uv is not None and not (np.abs(found.uv) < LARGEST).all():
        raise InputError(
            f"{path}: expected finite texture coordinates, found NaN, infinity or more than 1e9; "
            "repair them or export the mesh without."
        )
    beyond = (found.corners < 0) | (found.corners >= len(found.vertices))
    if beyond.any():
        raise InputError(
            f"{path}: expected faces of vertices 1 to {len(found.vertices)}, found {found.corners[beyond][0] + 1}; "
            "the file may be cut off: export it again."
        )
    if (found.sizes < 3).any():
        raise InputError(f"{path}: expected faces of three corners or more, found fewer than three; repair the mesh.")


def _fans(path: Path, found: _Polygons) -> MeshFile:
    """Cut polygons into fans of triangles from their first corner."""
    sizes = found.sizes
    first = np.cumsum(sizes) - sizes
    triangles_each = np.where(found.kept, sizes - 2, 0)
    polygon = np.repeat(np.arange(len(sizes)), triangles_each)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(triangles_each) - triangles_each, triangles_each)
    start = first[polygon]
    loops = np.stack([start, start + step + 1, start + step + 2], axis=1)
    corner_uv = None if found.uv is None else torch.from_numpy(found.uv[loops].astype(np.float32))
    vertices = torch.from_numpy(found.vertices.astype(np.float32))
    mesh = Mesh(vertices, torch.from_numpy(found.corners[loops]), corner_uv)
    if not float(face_areas(mesh).sum()) > 0:
        raise InputError(f"{path}: expected a surface, found faces without any area; export it as a surface.")
    return MeshFile(mesh, polygon, loops, len(sizes))


def _read_obj(path: Path) -> _Polygons:
    """Read vertices, texture coordinates, faces and groups of a Wavefront OBJ; everything else is skipped."""
    vertices: list[list[float]] = []
    textures: list[list[float]] = []
    sizes: list[int] = []
    corners: list[int] = []
    corner_textures: list[int] = []
    kept: list[bool] = []
    skin = True
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, start=1):
            words = line.split()
            kind = words[0] if words else ""
            try:
                if kind == "v":
                    x, y, z = (float(word) for word in words[1:4])
                    vertices.append([x, y, z])
                elif kind == "vt":
                    u, v = (float(word) for word in [*words[1:3], "0"][:2])
                    textures.append([u, v])
                elif kind == "g":
                    skin = not " ".join(words[1:]).startswith(HELPER_GROUPS)
                elif kind == "f":
                    parts = [word.split("/") for word in words[1:]]
                    corners += [_index(part[0], len(vertices)) for part in parts]
                    textured = (part[1] if len(part) > 1 else "" for part in parts)
                    corner_textures += [_index(word, len(textures)) if word else -1 for word in textured]
                    sizes.append(len(parts))
                    kept.append(skin)
            except ValueError as error:
                expected = "a face of existing vertices, such as f 1 2 3" if kind == "f" else "three finite numbers"
                expected = "two numbers" if kind == "vt" else expected
                raise InputError(
                    f"{path}: line {number}: expected {expected}, found {excerpt(line.strip())}; export it again."
                ) from error
    uv = None
    if textures and min(corner_textures, default=-1) >= 0:
        if max(corner_textures) >= len(textures):
            raise InputError(
                f"{path}: expected faces of texture points 1 to {len(textures)}, found {max(corner_textures) + 1}; "
                "the file may be cut off: export it again."
            )
        uv = np.array(textures)[corner_textures]
    positions = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    return _Polygons(positions, _whole(sizes), _whole(corners), uv, np.array(kept, dtype=bool))


def _index(word: str, count: int) -> int:
    """Convert an OBJ index (from 1, or negative and counted back from the last) to an index from 0.

    Raises:
        ValueError: the word is not such a number.
    """
    number = int(word)
    if number == 0 or abs(number) > LARGEST or number < -count:
        raise ValueError(f"no index: {number}")
    return number - 1 if number > 0 else count + number


def _whole(values: Sequence[int]) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def _read_with_trimesh(path: Path) -> _Polygons:
    """Read a PLY polygon by polygon, or one of the formats that only have triangles."""
    import trimesh
    from trimesh.exchange.ply import load_ply

    # Read from memory: false claims about lengths cannot exceed it, and files that this one refers to are not opened.
    content = BytesIO(read_bytes(path, "a mesh file"))
    try:
        if path.suffix.lower() == ".ply":
            return _polygons_of_ply(load_ply(content, skip_materials=True)["metadata"]["_ply_raw"])
        loaded = trimesh.load(content, file_type=path.suffix[1:].lower(), process=False, force="mesh")
    except Exception as error:
        raise InputError(
            f"{path}: expected a {path.suffix[1:].upper()} mesh, but it cannot be read as one "
            f"({reason(error)}); export it again, for instance as .obj."
        ) from error
    if not isinstance(loaded, trimesh.Trimesh):
        raise InputError(f"{path}: expected a mesh with faces, found none; export it as a surface.")
    vertices, faces = np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, dtype=np.int64)
    uv = getattr(loaded.visual, "uv", None)
    corner_uv = None if uv is None else np.asarray(uv)[faces].reshape(-1, 2)
    if len(vertices) == faces.size:
        # STL repeats every corner; merge equal vertices, so that faces are connected.
        vertices, shared = np.unique(vertices, axis=0, return_inverse=True)
        faces = shared.reshape(-1)[faces]
    return _Polygons(vertices, np.full(len(faces), 3), faces.reshape(-1), corner_uv, np.ones(len(faces), dtype=bool))


def _polygons_of_ply(elements: dict) -> _Polygons:
    """Take polygons from the PLY's own tables, because trimesh would cut them into triangles in another order.

    Raises:
        KeyError: there are no vertices or no faces.
        ValueError: the texture coordinates are not two per corner.
    """
    table, faces = elements["vertex"]["data"], elements["face"]["data"]
    vertices = np.column_stack([table[axis] for axis in "xyz"]).astype(np.float64)
    name = next(name for name in elements["face"]["properties"] if name in ("vertex_indices", "vertex_index"))
    polygons = [np.asarray(polygon, dtype=np.int64) for polygon in _lists(faces, name)]
    corners = np.concatenate(polygons)
    uv = None
    if "texcoord" in elements["face"]["properties"]:
        uv = np.concatenate([np.asarray(row, dtype=np.float64) for row in _lists(faces, "texcoord")]).reshape(-1, 2)
    for names in PLY_TEXTURE_NAMES:
        if uv is None and set(names) <= set(elements["vertex"]["properties"]):
            uv = np.column_stack([table[column] for column in names]).astype(np.float64)[corners]
    if uv is not None and len(uv) != len(corners):
        raise ValueError("texture coordinates that are not two a corner")
    sizes = _whole([len(polygon) for polygon in polygons])
    return _Polygons(vertices, sizes, corners, uv, np.ones(len(sizes), dtype=bool))


def _lists(table: dict | np.ndarray, name: str) -> np.ndarray:
    """A column of lists; in binary tables each is stored with its length before it."""
    return table[name] if isinstance(table, dict) else table[name]["f1"]
