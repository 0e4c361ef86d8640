"""Make a .blend of exported hair, with a hair material that takes each strand's colour, a light and a camera.

neural-strands export RUN hair.usd && blender/bin/python examples/06_blend_hair.py hair.usd hair.blend [hair.png]

Runs in a Python that has Blender's module: python3.11 -m venv blender && blender/bin/pip install bpy
"""

import importlib
import sys
from pathlib import Path
from typing import Any


def main(usd: Path, blend: Path, picture: Path | None = None) -> None:
    """Import strands from USD, dress them, save a scene and, if a PNG file is given, render it."""
    bpy = importlib.import_module("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(usd.absolute()))
    scene = bpy.context.scene
    for hair in [shown for shown in bpy.data.objects if shown.type == "CURVES"]:
        hair.data.materials.clear()
        hair.data.materials.append(hair_material(bpy))
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3.0, (0.8, 0.2, 0.6)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    # In front of a head at the origin: Blender's z is up, and the face looks along -y.
    camera.location, camera.rotation_euler, camera.data.lens = (0.0, -0.8, 0.08), (1.45, 0.0, 0.0), 80
    scene.collection.objects.link(sun)
    scene.collection.objects.link(camera)
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.6, 0.6, 0.6, 1.0)
    scene.camera, scene.render.engine = camera, "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y, scene.cycles.samples = 400, 400, 64
    bpy.ops.wm.save_as_mainfile(filepath=str(blend.absolute()))
    if picture is not None:
        scene.render.filepath = str(picture.absolute())
        bpy.ops.render.render(write_still=True)


def hair_material(bpy: Any) -> Any:
    """Blender's Principled Hair BSDF, coloured by the attribute `displayColor`."""
    material = bpy.data.materials.new("hair")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    kinds = ("OutputMaterial", "BsdfHairPrincipled", "Attribute")
    output, shader, colour = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    shader.parametrization, colour.attribute_name = "COLOR", "displayColor"
    tree.links.new(colour.outputs["Color"], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
