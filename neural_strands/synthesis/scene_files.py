"""Writes the two file formats in which Mitsuba reads geometry: curves as text, meshes with vertex colours as PLY."""

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.mesh import Mesh, vertex_normals


def write_curves(path: Path, points: Float[Tensor, "strand point 3"], width: Float[Tensor, "strand point"]) -> None:
    """Write strands as lines of x, y, z and radius (metres), with a blank line between strands."""
    rows = torch.cat([points, width[..., None] / 2], dim=-1).double().cpu().numpy()
    template = "%.6f %.6f %.6f %.8f\n" * points.shape[1] + "\n"
    with path.open("w") as file:
        file.writelines(template % tuple(row) for row in rows.reshape(len(rows), -1).tolist())


def write_coloured_mesh(path: Path, mesh: Mesh, colours: Float[Tensor, "vertex 3"]) -> None:
    """Write a binary PLY with smooth normals and linear RGB at its vertices."""
    normals = vertex_normals(mesh)
    names = ["x", "y", "z", "nx", "ny", "nz", "r", "g", "b"]
    vertices = torch.cat([mesh.vertices, normals, colours], dim=-1).float().cpu().numpy().astype("<f4")
    faces = np.zeros(len(mesh.faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, mesh.faces.cpu().numpy()
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in names),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    path.write_bytes("\n".join([*header, ""]).encode() + vertices.tobytes() + faces.tobytes())
