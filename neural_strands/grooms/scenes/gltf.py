"""`.glb` files (glTF 2.0, binary): strands as coloured lines, for web pages and viewers; write-only.

All strands are one primitive of line segments, so that a browser draws them in one call. Stored: points (metres, y up,
as glTF requires), linear colours, and the share of a strand that no photograph could see, repeated at each of its
points (attribute `_UNSEEN`; glTF lets applications name attributes that begin with an underscore). Widths are lost:
glTF's lines are one pixel wide. The material is unlit (KHR_materials_unlit) because lines have no normals.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped
from torch import Tensor

from neural_strands.grooms.groom import Groom

FLOAT, UNSIGNED_INT, UNSIGNED_SHORT = 5126, 5125, 5123
"""glTF's codes for component types."""
VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""
LINES = 1
"""Primitive mode: every two indices form a segment."""
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


def write_glb(path: Path, groom: Groom) -> None:
    """Write the strands as lines."""
    vertices = np.ascontiguousarray(groom.vertices.cpu().numpy(), np.float32)
    last = np.zeros(len(vertices), bool)
    last[groom.offsets[1:].cpu().numpy() - 1] = True
    start = np.flatnonzero(~last).astype(np.uint32)
    parts: list[tuple[np.ndarray, int, dict[str, Any]]] = [
        (np.stack([start, start + 1], axis=1), INDICES, {"componentType": UNSIGNED_INT, "type": "SCALAR"}),
        (
            vertices,
            VERTICES,
            {
                "componentType": FLOAT,
                "type": "VEC3",
                "min": vertices.min(axis=0).tolist(),
                "max": vertices.max(axis=0).tolist(),
            },
        ),
    ]
    attributes = {"POSITION": 1}
    if groom.color is not None:
        per_vertex = _at_points(groom.color, groom)
        # Four samples per row, because glTF aligns rows to four bytes.
        samples = np.full((len(vertices), 4), 65535, np.uint16)
        samples[:, :3] = np.clip(per_vertex, 0, 1) * 65535 + 0.5
        parts.append((samples, VERTICES, {"componentType": UNSIGNED_SHORT, "type": "VEC4", "normalized": True}))
        attributes["COLOR_0"] = len(parts) - 1
    if groom.unseen is not None:
        shares = np.ascontiguousarray(_at_points(groom.unseen, groom), np.float32)
        parts.append((shares, VERTICES, {"componentType": FLOAT, "type": "SCALAR"}))
        attributes["_UNSEEN"] = len(parts) - 1
    views, accessors, offset = [], [], 0
    for number, (values, target, kind) in enumerate(parts):
        count = values.size if kind["type"] == "SCALAR" else len(values)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": values.nbytes, "target": target})
        accessors.append({"bufferView": number, "count": count, **kind})
        offset += values.nbytes
    document = {
        "asset": {"version": "2.0", "generator": "neural-strands"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "hair"}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 0, "material": 0, "mode": LINES}]}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with path.open("wb") as file:
        file.write(struct.pack("<III", MAGIC, 2, 12 + 8 + len(text) + 8 + offset))
        file.write(struct.pack("<II", len(text), JSON_CHUNK) + text)
        file.write(struct.pack("<II", offset, BINARY_CHUNK))
        for values, _, _ in parts:
            file.write(values.tobytes())


def _at_points(values: Shaped[Tensor, " strand *value"], groom: Groom) -> np.ndarray:
    """Values of strands, repeated at each of their points."""
    return values.repeat_interleave(groom.sizes.to(values.device), dim=0).cpu().numpy()
