"""Clay-like meshes: shading is baked into the vertices, so that a browser draws them without lights.

Without a graphics card, a browser takes about ten seconds to compile viser's lit material, and the page freezes
meanwhile. An unlit one (KHR_materials_unlit) takes less than a second.
"""

from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8

from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.pictures.encoding import to_bytes

TOWARDS_LIGHT = (0.35, 0.55, 0.76)
"""Unit direction of the light: above the viewer's right shoulder, when the face is in front."""
LIGHT, SKY, AMBIENT = 0.6, 0.25, 0.15
"""Shares of the light from that direction, from above, and from all around."""


def clay_glb(mesh: Mesh, colour: tuple[int, int, int]) -> bytes:
    """A binary glTF file of a mesh in one colour.

    Args:
        mesh: the mesh, with faces oriented outwards.
        colour: sRGB, 0 to 255.
    """
    import trimesh
    from trimesh.exchange.gltf import export_glb
    from trimesh.visual import ColorVisuals

    shaded = trimesh.Trimesh(mesh.vertices.cpu().numpy(), mesh.faces.cpu().numpy(), process=False)
    shaded.visual = ColorVisuals(shaded, vertex_colors=_shades(mesh, colour))
    return export_glb(trimesh.Scene(shaded), include_normals=False, tree_postprocessor=_unlit)


def _shades(mesh: Mesh, colour: tuple[int, int, int]) -> UInt8[np.ndarray, "vertex 3"]:
    """Linear colours (as glTF requires) of diffuse shading."""
    normals = vertex_normals(mesh).cpu()
    facing = (normals @ normals.new_tensor(TOWARDS_LIGHT)).clamp(min=0.0)
    light = LIGHT * facing + SKY * 0.5 * (1 + normals[:, 1]) + AMBIENT
    return to_bytes(light[:, None] * to_linear(torch.tensor(colour) / 255))


def _unlit(document: dict[str, Any]) -> None:
    document["materials"] = [{"doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}]
    document["extensionsUsed"] = ["KHR_materials_unlit"]
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["material"] = 0
