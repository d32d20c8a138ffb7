"""Rendering of depth, exposure and views by the camera of a scene."""

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
from .scene import SceneDescription
from .shading import Graph
from .stage import look_at

MIDDLE_GREY = 0.17
"""Linear value to which the exposure maps the geometric mean of the image."""

BRIGHT_PERCENTILE, MAX_BRIGHT_VALUE = 92, 0.6
"""Percentile of the image, and the linear value that it may reach at most after exposure."""

PREVIEW_SIZE_PX, PREVIEW_SAMPLES = 96, 8
"""Longer side and rays per pixel of the image that the exposure is measured on."""


class Camera:
    """Camera that moves from view to view of a scene.

    Args:
        scene: The scene that :func:`.stage.build` built.
        image_size: ``(h, w)`` in pixels.
        threads: Threads of the renderer; 0 for one per core.
    """

    def __init__(
        self, scene: SceneDescription, image_size: tuple[int, int], threads: int = 0
    ) -> None:
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
        # Blender's dither is equal in all views, which would be a texture of disparity zero.
        stage.render.dither_intensity = 0.0
        stage.view_settings.view_transform = "AgX"
        stage.view_settings.look = "AgX - Medium High Contrast"
        self._size = image_size

    def measure(self) -> dict[str, np.ndarray]:
        """Measure depth, object number and normal at each pixel centre of the centre view.

        All surfaces emit their depth and number, and one ray is cast through each pixel. The pixel
        filter is so narrow that the ray passes within a hundredth of a pixel of the centre.

        Returns:
            Maps ``[h, w]``: ``depth``, metres along the optical axis (infinite for background);
            ``objects``, object number from 1 (0 for background); ``facing``, a value that is
            constant only where the surface normal is.
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
        """Return the exposure in stops, measured on a small noisy image."""
        height, width = (max(8, PREVIEW_SIZE_PX * side // max(self._size)) for side in self._size)
        picture = self._linear_picture((height, width), PREVIEW_SAMPLES)
        grey = np.maximum(picture @ np.array([0.2126, 0.7152, 0.0722]), 1e-4)
        middle, bright = np.exp(np.log(grey).mean()), np.percentile(grey, BRIGHT_PERCENTILE)
        return math.log2(min(MIDDLE_GREY / middle, MAX_BRIGHT_VALUE / bright))

    def take(
        self,
        path: Path,
        rig: Rig,
        step: tuple[float, float],
        *,
        samples: int,
        exposure: float,
        seed: int,
    ) -> None:
        """Render one view to a PNG file, which appears when it is complete.

        Args:
            path: The file.
            rig: Positions of the cameras.
            step: ``(rows, columns)`` from the centre view.
            samples: Rays per pixel.
            exposure: Exposure in stops.
            seed: Seed of the noise. It must differ between views: equal noise would be a texture
                of disparity zero.
        """
        stage = bpy.context.scene
        right, up = rig.offset(*step)
        self._camera.matrix_world = self._centre @ mathutils.Matrix.Translation((right, up, 0.0))
        self._data.shift_x, self._data.shift_y = rig.sensor_shift(right, up)
        stage.render.resolution_y, stage.render.resolution_x = self._size
        stage.view_settings.exposure = exposure
        stage.cycles.samples, stage.cycles.seed = samples, seed
        settings = stage.render.image_settings
        settings.file_format, settings.color_mode, settings.color_depth = "PNG", "RGB", "8"
        # Only the camera moves between views. Data must not persist before the first view, because
        # the table of random numbers would persist too, and it depends on the number of samples.
        stage.render.use_persistent_data = True
        temporary = path.with_name(f".{path.name}")
        stage.render.filepath = str(temporary)
        bpy.ops.render.render(write_still=True)
        temporary.write_bytes(essential_chunks(temporary.read_bytes()))
        os.replace(temporary, path)

    def _linear_picture(self, size: tuple[int, int], samples: int) -> np.ndarray:
        """Return ``[h, w, 3]`` radiance seen by the centre camera."""
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
    """Make a material that emits depth as red, object number as green and normal as blue."""
    material = bpy.data.materials.new("measure")
    material.use_nodes = True
    graph = Graph(material.node_tree)
    depth = graph.add("CameraData").outputs["View Z Depth"]
    number = graph.add("ObjectInfo").outputs["Object Index"]
    normal = graph.add("NewGeometry").outputs["True Normal"]
    # Cosine with an arbitrary direction; adding 2 keeps the emission positive.
    cosine = graph.add("VectorMath", {0: normal, 1: (0.36, 0.48, 0.8)}, operation="DOT_PRODUCT")
    facing = graph.math("ADD", cosine.outputs["Value"], 2.0)
    colour = graph.add("CombineXYZ", {0: depth, 1: number, 2: facing}).outputs[0]
    shine = graph.add("Emission", {"Color": colour})
    graph.add("OutputMaterial", {"Surface": shine.outputs[0]})
    return material
