"""A separate program, started by `alembic.py`, that writes Alembic with Blender.

It runs in any Python that has `bpy`, so it imports nothing from this package. It reads a JSON document from standard
input,

    {"out": path, "objects": [{"name": text, "arrays": npz, "guide": 0 or 1, "frames": npy, "fps": number}, ...]}

where the arrays are `vertices` (metres, y up), `sizes` and optionally `width`, and `frames` and `fps` are optional.
"""

import importlib
import json
import sys
from typing import Any

FIRST_FRAME = 0


def main() -> int:
    """Build the curves and export them; returns the exit status."""
    request = json.loads(sys.stdin.read())
    bpy: Any = importlib.import_module("bpy")
    import numpy as np

    bpy.ops.wm.read_factory_settings(use_empty=True)
    moving = []
    for part in request["objects"]:
        with np.load(part["arrays"]) as archive:
            arrays = dict(archive)
        curves = bpy.data.hair_curves.new(part["name"])
        curves.add_curves(arrays["sizes"].tolist())
        curves.set_types(type="POLY")
        place(curves, arrays["vertices"])
        if "width" in arrays:
            radius = curves.attributes.new("radius", "FLOAT", "POINT")
            radius.data.foreach_set("value", (0.5 * arrays["width"]).astype(np.float32))
        shown = bpy.data.objects.new(part["name"], curves)
        shown["groom_group_id"] = 0
        shown["groom_guide"] = part["guide"]
        bpy.context.scene.collection.objects.link(shown)
        if "frames" in part:
            moving.append((curves, np.load(part["frames"], mmap_mode="r"), part["fps"]))
    last = FIRST_FRAME
    for curves, frames, fps in moving:
        last = FIRST_FRAME + len(frames) - 1
        # Blender's frame rate is a whole number over a base.
        bpy.context.scene.render.fps = max(1, round(fps))
        bpy.context.scene.render.fps_base = max(1, round(fps)) / fps

        # The exporter writes only one sample of an object without animation, so animate a dummy property.
        curves["frame"] = 0.0
        curves.keyframe_insert(data_path='["frame"]', frame=FIRST_FRAME)

        def follow(scene: Any, *_: Any, curves: Any = curves, frames: Any = frames) -> None:
            place(curves, frames[min(max(scene.frame_current - FIRST_FRAME, 0), len(frames) - 1)])
            curves.update_tag()

        bpy.app.handlers.frame_change_pre.append(follow)
    # The exporter must step through every frame, so it must not run in the background.
    bpy.ops.wm.alembic_export(filepath=request["out"], start=FIRST_FRAME, end=last, as_background_job=False)
    return 0


def place(curves: Any, vertices: Any) -> None:
    """Convert points to Blender's axes (z up) and assign them."""
    import numpy as np

    turned = np.stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]], axis=1).astype(np.float32)
    curves.attributes["position"].data.foreach_set("vector", turned.ravel())


if __name__ == "__main__":
    sys.exit(main())
