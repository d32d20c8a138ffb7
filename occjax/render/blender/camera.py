"""Pictures of the stage: depth, exposure, and the views."""

from __future__ import annotations

import math
import os
import tempfile
from pathlib import Path

import bpy
import mathutils
import numpy as np

from .geometry import SENSOR_SIZE_MM, Rig
from .png import essential_chunks
from .scene import Scene
from .shading import Graph
from .stage import look_at

MIDDLE_GREY = 0.17
"""Linear value that the geometric mean of the picture is exposed to."""

BRIGHT_PERCENTILE = 92
WHITE = 0.6
"""Linear value that the bright parts are exposed to at most, where much of the picture is dark."""

PREVIEW_SIZE = 96
PREVIEW_SAMPLES = 8


class Camera:
    """The camera of a scene, moved from view to view.

    Args:
        scene: The scene that was built.
        image_size: ``(h, w)`` in pixels.
        threads: Of the renderer; 0 for as many as there are cores.
    """

    def __init__(self, scene: Scene, image_size: tuple[int, int], threads: int = 0) -> None:
        self._data = bpy.data.cameras.new("camera")
        self._data.lens, self._data.sensor_width = scene.lens_mm, SENSOR_SIZE_MM
        self._data.clip_start, self._data.clip_end = 0.01, 1000.0
        self._camera = bpy.data.objects.new("camera", self._data)
        self._centre = look_at(scene.eye, scene.target)
        self._camera.matrix_world = self._centre
        stage = bpy.context.scene
        stage.collection.objects.link(self._camera)
        stage.camera = self._camera
        stage.render.engine = "CYCLES"
        stage.render.threads_mode, stage.render.threads = (
            ("FIXED", threads) if threads else ("AUTO", 0)
        )
        stage.cycles.device = "CPU"
        stage.cycles.use_adaptive_sampling = False
        stage.cycles.use_denoising = False
        stage.cycles.max_bounces, stage.cycles.diffuse_bounces = 6, 2
        stage.cycles.glossy_bounces, stage.cycles.transmission_bounces = 2, 6
        stage.cycles.caustics_reflective = stage.cycles.caustics_refractive = False
        stage.cycles.blur_glossy = 0.5
        stage.cycles.sample_clamp_indirect = 3.0
        # Blender's dither is the same in all views: a texture of disparity zero.
        stage.render.dither_intensity = 0.0
        stage.view_settings.view_transform = "AgX"
        stage.view_settings.look = "AgX - Medium High Contrast"
        self._size = image_size

    def measure(self) -> dict[str, np.ndarray]:
        """What the middle of each pixel of the centre view sees, without anti-aliasing.

        All surfaces are made to shine with their depth and number, and one ray is cast through
        each pixel; the filter is too narrow for it to miss the middle by a hundredth of a pixel.

        Returns:
            Maps ``[h, w]``: ``depth``, metres along the camera's axis (infinite where there is
            nothing); ``objects``, number of the object from 1 (0 where there is nothing);
            ``facing``, a number that is constant only where the normal of the surface is.
        """
        stage, layer = bpy.context.scene, bpy.context.view_layer
        world = stage.world
        layer.material_override, stage.world = _measuring_material(), None
        stage.cycles.pixel_filter_type, stage.cycles.filter_width = "GAUSSIAN", 0.01
        measured = self._linear_picture(self._size, samples=1)
        stage.cycles.pixel_filter_type, stage.cycles.filter_width = "BLACKMAN_HARRIS", 1.5
        layer.material_override, stage.world = None, world
        number = np.rint(measured[..., 1]).astype(np.int32)
        depth = np.where(number > 0, measured[..., 0], np.float32(np.inf))
        return {"depth": depth, "objects": number, "facing": measured[..., 2]}

    def expose(self) -> float:
        """Set the exposure by a small noisy picture; returns it in stops."""
        height, width = (max(8, PREVIEW_SIZE * side // max(self._size)) for side in self._size)
        picture = self._linear_picture((height, width), PREVIEW_SAMPLES)
        grey = np.maximum(picture @ np.array([0.2126, 0.7152, 0.0722]), 1e-4)
        middle, bright = np.exp(np.log(grey).mean()), np.percentile(grey, BRIGHT_PERCENTILE)
        return math.log2(min(MIDDLE_GREY / middle, WHITE / bright))

    def take(
        self,
        path: Path,
        rig: Rig,
        step: tuple[float, float],
        *,
        samples: int,
        exposure: float,
        denoise: bool,
        seed: int,
    ) -> None:
        """Render one view to a PNG, which appears when it is complete.

        Args:
            path: The file.
            rig: Where the cameras are.
            step: ``(rows, columns)`` from the centre view.
            samples: Rays per pixel.
            exposure: In stops.
            denoise: Whether to remove noise; what it guesses differs from view to view.
            seed: Of the noise, which must not be the same in two views: it would be a texture
                of disparity zero.
        """
        stage = bpy.context.scene
        right, up = rig.offset(*step)
        self._camera.matrix_world = self._centre @ mathutils.Matrix.Translation((right, up, 0.0))
        self._data.shift_x, self._data.shift_y = rig.sensor_shift(right, up)
        stage.render.resolution_y, stage.render.resolution_x = self._size
        stage.view_settings.exposure = exposure
        stage.cycles.samples, stage.cycles.seed = samples, seed
        stage.cycles.use_denoising = denoise
        settings = stage.render.image_settings
        settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
        # Only the camera moves between views. Before, data must not persist: the table of random
        # numbers would, too, and is made for one number of samples.
        stage.render.use_persistent_data = True
        temporary = path.with_name(f".{path.name}")
        stage.render.filepath = str(temporary)
        bpy.ops.render.render(write_still=True)
        temporary.write_bytes(essential_chunks(temporary.read_bytes()))
        os.replace(temporary, path)

    def _linear_picture(self, size: tuple[int, int], samples: int) -> np.ndarray:
        """``[h, w, 3]`` radiance seen by the centre camera."""
        stage = bpy.context.scene
        stage.render.use_persistent_data = False
        self._camera.matrix_world = self._centre
        self._data.shift_x = self._data.shift_y = 0.0
        stage.render.resolution_y, stage.render.resolution_x = size
        stage.cycles.samples, stage.cycles.seed = samples, 0
        settings = stage.render.image_settings
        settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
        settings.exr_codec = "ZIP"
        with tempfile.TemporaryDirectory() as folder:
            stage.render.filepath = str(Path(folder) / "picture.exr")
            bpy.ops.render.render(write_still=True)
            image = bpy.data.images.load(stage.render.filepath)
            image.colorspace_settings.name = "Non-Color"
            pixels = np.empty(size[0] * size[1] * 4, np.float32)
            image.pixels.foreach_get(pixels)
            bpy.data.images.remove(image)
        return pixels.reshape(*size, 4)[::-1, :, :3].copy()


def _measuring_material() -> bpy.types.Material:
    """Shines with the depth in red, the number of the object in green, the normal in blue."""
    material = bpy.data.materials.new("measure")
    material.use_nodes = True
    graph = Graph(material.node_tree)
    depth = graph.add("CameraData").outputs["View Z Depth"]
    number = graph.add("ObjectInfo").outputs["Object Index"]
    normal = graph.add("NewGeometry").outputs["True Normal"]
    # Cosine with an arbitrary direction; 2 keeps it positive, as light has to be.
    cosine = graph.add("VectorMath", {0: normal, 1: (0.36, 0.48, 0.8)}, operation="DOT_PRODUCT")
    facing = graph.math("ADD", cosine.outputs["Value"], 2.0)
    colour = graph.add("CombineXYZ", {0: depth, 1: number, 2: facing}).outputs[0]
    shine = graph.add("Emission", {"Color": colour})
    graph.add("OutputMaterial", {"Surface": shine.outputs[0]})
    return material
