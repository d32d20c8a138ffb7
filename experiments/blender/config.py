"""Settings that determine a rendered scene."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from occjax.errors import InputError

Style = Literal["mixed", "still_life", "room", "garden", "shelf", "wires"]
STYLES: tuple[Style, ...] = get_args(Style)

MIN_IMAGE_SIZE_PX = 8
"""Minimum height and width of a view: the exposure is measured on the image."""


@dataclass(frozen=True)
class RenderConfig:
    """Settings of one scene; equal settings give the same light field.

    Attributes:
        seed: Seed of the objects, the light, the camera and the noise.
        style: Kind of scene, one of :data:`STYLES`. ``"mixed"`` chooses one of the others by the
            seed.
        image_size: ``(h, w)`` of each view, in pixels.
        grid: ``(V, U)`` number of view rows and columns; the centre view is
            :func:`occjax.lightfield.centre_index`.
        samples: Rays per pixel. The rendering time is proportional to it.

    Raises:
        InputError: If a value is out of range.
    """

    seed: int = 0
    style: str = "mixed"
    image_size: tuple[int, int] = (256, 256)
    grid: tuple[int, int] = (9, 9)
    samples: int = 32

    def __post_init__(self) -> None:
        """Reject values that Blender would fail on later or change silently."""
        if self.seed < 0:
            raise InputError(f"seed is {self.seed}; it must not be negative")
        if self.style not in STYLES:
            raise InputError(f"style is {self.style!r}; it must be one of {', '.join(STYLES)}")
        if min(self.image_size) < MIN_IMAGE_SIZE_PX:
            raise InputError(
                f"image size is {self.image_size}; the minimum is {MIN_IMAGE_SIZE_PX} pixels"
            )
        if min(self.grid) < 1 or self.views > 999:
            raise InputError(f"grid is {self.grid}; it must have 1 to 999 views")
        if self.samples < 1:
            raise InputError(f"samples is {self.samples}; it must be at least 1")

    @property
    def views(self) -> int:
        """Number of views."""
        return self.grid[0] * self.grid[1]

    def as_dict(self) -> dict[str, Any]:
        """Return the values as JSON represents them: tuples become lists."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }
