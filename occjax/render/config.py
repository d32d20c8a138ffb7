"""What a rendered scene is determined by."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from occjax.errors import InputError

Style = Literal["mixed", "still_life", "room", "garden", "shelf", "wires"]
STYLES: tuple[Style, ...] = get_args(Style)

SMALLEST_IMAGE = 8
"""Pixels on the shorter side, at least: the exposure is measured on the picture."""


@dataclass(frozen=True)
class RenderConfig:
    """One scene; the same values give the same light field.

    Attributes:
        seed: Decides what is in the scene, its light, its camera and the noise.
        style: Kind of scene; one of :data:`STYLES`. ``"mixed"`` takes the others in turn, by the
            seed.
        image_size: ``(h, w)`` of each view in pixels.
        grid: ``(V, U)`` views; the centre one is that of :mod:`occjax.lightfield`.
        samples: Rays per pixel. Their number is what a rendering costs, and its noise.
        denoise: Remove the noise by a network of Blender's. What it makes up where there is noise
            differs from view to view, so matching suffers more than from the noise.

    Raises:
        InputError: If a value is none that can be rendered.
    """

    seed: int = 0
    style: str = "mixed"
    image_size: tuple[int, int] = (256, 256)
    grid: tuple[int, int] = (9, 9)
    samples: int = 32
    denoise: bool = False

    def __post_init__(self) -> None:
        """Check what Blender would fail on later, or quietly change."""
        if self.seed < 0:
            raise InputError(f"seed is {self.seed}; it must not be negative")
        if self.style not in STYLES:
            raise InputError(f"no style {self.style!r}; choose from {', '.join(STYLES)}")
        if min(self.image_size) < SMALLEST_IMAGE:
            raise InputError(
                f"image size is {self.image_size}; each side needs {SMALLEST_IMAGE} pixels or more"
            )
        if min(self.grid) < 1 or self.views > 999:
            raise InputError(f"grid is {self.grid}; it must have 1 to 999 views")
        if self.samples < 1:
            raise InputError(f"samples is {self.samples}; it must be at least 1")

    @property
    def views(self) -> int:
        """Number of views."""
        return self.grid[0] * self.grid[1]

    @property
    def centre(self) -> int:
        """Number of the centre view."""
        return self.grid[0] // 2 * self.grid[1] + self.grid[1] // 2

    def as_dict(self) -> dict[str, Any]:
        """The values as JSON has them."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }
