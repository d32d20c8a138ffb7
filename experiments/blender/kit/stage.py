"""Build a :class:`.scene.SceneDescription` in Blender: objects, lamps and sky."""

from __future__ import annotations

import math

import bpy
import mathutils
import numpy as np

from .mesh import Mesh
from .scene import Light, SceneDescription, Sky
from .shading import Graph, material

SHARP_EDGE_RAD = math.radians(35.0)
"""Angle between faces above which their edge is shaded sharp, in radians."""


def build(scene: SceneDescription) -> None:
    """Replace the contents of Blender by the scene; objects are numbered from 1 in order."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    materials = {
        surface: material(surface) for surface in dict.fromkeys(p.surface for p in scene.parts)
    }
    for number, part in enumerate(scene.parts, start=1):
        data = _mesh(part.mesh)
        data.materials.append(materials[part.surface])
        thing = _add(f"part {number}", data)
        thing.matrix_world = mathutils.Matrix(part.matrix.tolist())
        thing.pass_index = number
    for light in scene.lights:
        _light(light)
    _sky(scene.sky)


def _mesh(mesh: Mesh) -> bpy.types.Mesh:
    data = bpy.data.meshes.new("mesh")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.faces.tolist())
    data.validate()
    data.shade_smooth()
    data.set_sharp_from_angle(angle=SHARP_EDGE_RAD)
    return data


def _light(light: Light) -> None:
    data = bpy.data.lights.new("light", light.kind)
    data.energy, data.color = light.power, light.colour
    if light.kind == "SUN":
        data.angle = light.size
    else:
        data.size = light.size
    lamp = _add("light", data)
    lamp.visible_camera = False
    lamp.matrix_world = look_at(light.location, light.target)


def _sky(sky: Sky) -> None:
    """Add a gradient with brighter and darker patches, which are visible in reflections."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.use_nodes = True
    graph = Graph(world.node_tree)
    direction = graph.add("TexCoord").outputs["Generated"]
    height = graph.add("SeparateXYZ", {0: direction}).outputs[2]
    gradient = graph.ramp(height, [(0.0, sky.horizon), (0.7, sky.zenith)])
    rng = np.random.default_rng(sky.seed)
    shifted = graph.add("Mapping", {"Vector": direction})
    shifted.inputs["Location"].default_value = rng.uniform(-50.0, 50.0, 3)
    patches = graph.ramp(
        graph.noise(shifted.outputs[0], 2.0, 2.0), [(0.35, (0.4,) * 3), (0.65, (1.6,) * 3)]
    )
    strength = graph.math("MULTIPLY", patches, sky.strength)
    shader = graph.add("Background", {"Color": gradient, "Strength": strength})
    graph.add("OutputWorld", {"Surface": shader.outputs[0]})


def look_at(eye, target) -> mathutils.Matrix:
    """Return the pose of an upright camera or lamp at ``eye`` that looks at ``target``."""
    eye = mathutils.Vector(eye)
    forward = mathutils.Vector(target) - eye
    turned = forward.to_track_quat("-Z", "Y").to_matrix().to_4x4()
    return mathutils.Matrix.Translation(eye) @ turned


def _add(name: str, data) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing
