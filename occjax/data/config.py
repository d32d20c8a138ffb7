"""Settings of the augmentation, in a module that does not import JAX."""

from __future__ import annotations

from dataclasses import dataclass

from occjax.errors import InputError


@dataclass(frozen=True)
class AugmentationConfig:
    """Settings of the augmentation of training light fields.

    Attributes:
        crop: ``(height, width)`` of the patch that is cut out at a random position; None keeps
            whole views.
        flips: Whether rows and columns, of grid and views together, are each reversed with
            probability 1/2.
        turns: Whether grid and views are transposed with probability 1/2; views or crops must then
            be square. With flips, all eight symmetries of a square are equally likely.
        gamma: Largest exponent of the grey values; drawn log-uniformly from
            ``[1 / gamma, gamma]``.
        contrast: Largest contrast factor about mid-grey; drawn log-uniformly from
            ``[1 / contrast, contrast]``.
        brightness: Largest grey value that is added or subtracted, in [0, 1].
        noise: Largest standard deviation of Gaussian noise, as a grey value; drawn uniformly from
            0 to this.
        noise_probability: Probability that a light field gets noise.
    """

    crop: tuple[int, int] | None = None
    flips: bool = True
    turns: bool = True
    gamma: float = 1.2
    contrast: float = 1.2
    brightness: float = 0.1
    noise: float = 0.03
    noise_probability: float = 0.5

    def __post_init__(self) -> None:
        """Check the values."""
        if self.crop is not None and min(self.crop) < 1:
            raise InputError(f"crop is {self.crop}; it must be a positive height and width")
        if self.turns and self.crop is not None and self.crop[0] != self.crop[1]:
            raise InputError(f"crop is {self.crop}; make it square or set turns to False")
        if min(self.gamma, self.contrast) < 1.0:
            raise InputError(
                f"gamma is {self.gamma} and contrast {self.contrast}; they must be at least 1"
            )
        if min(self.brightness, self.noise) < 0.0:
            raise InputError(
                f"brightness is {self.brightness} and noise {self.noise}; they must be at least 0"
            )
        if not 0.0 <= self.noise_probability <= 1.0:
            raise InputError(
                f"noise_probability is {self.noise_probability}; it must be between 0 and 1"
            )
