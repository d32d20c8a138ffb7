"""Photorealistic light fields with exact ground truth, rendered in Blender."""

from occjax.render.config import STYLES, RenderConfig
from occjax.render.rendering import find_blender, render_scene

__all__ = ["STYLES", "RenderConfig", "find_blender", "render_scene"]
