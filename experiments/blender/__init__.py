"""Photorealistic random light fields with exact ground truth, rendered in Blender."""

from experiments.blender.config import STYLES, RenderConfig
from experiments.blender.rendering import find_blender, render_scene

__all__ = ["STYLES", "RenderConfig", "find_blender", "render_scene"]
