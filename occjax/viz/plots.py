"""Drawings of light fields and estimates into Matplotlib axes, for scripts and notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Colormap, Normalize

from occjax.errors import InputError, check_one_of
from occjax.lightfield import LightField
from occjax.viz.colour import (
    colourbar_extend,
    confidence_colours,
    disparity_colours,
    disparity_norm,
)
from occjax.viz.figures import CONFIDENCE_LABEL, DISPARITY_LABEL, ERROR_LABEL
from occjax.viz.pictures import error_picture, error_scale, view_picture

if TYPE_CHECKING:
    from occjax.estimators.protocol import Estimate

Quantity = Literal["disparity", "confidence", "error"]
"""Map that :func:`plot_estimate` draws."""


def plot_light_field(light_field: LightField, axes: Axes | None = None) -> Axes:
    """Draw the centre view; see :meth:`occjax.LightField.plot`."""
    axes = _axes(axes)
    axes.imshow(view_picture(light_field.centre), interpolation="nearest")
    axes.set_title(light_field.name)
    axes.set_axis_off()
    return axes


def plot_estimate(estimate: Estimate, quantity: Quantity, axes: Axes | None = None) -> Axes:
    """Draw a map of an estimate with its colour bar; see :meth:`occjax.Estimate.plot`."""
    check_one_of("quantity", quantity, Quantity)
    truth = None if estimate.light_field is None else estimate.light_field.ground_truth
    values = estimate.disparity
    norm: Normalize
    colours: Colormap
    ticks = None
    if quantity == "error":
        if truth is None:
            raise InputError("the light field has no ground truth; plot the disparity")
        norm, colours, ticks = error_scale()
        values, label = error_picture(values, truth), ERROR_LABEL
    elif quantity == "confidence":
        norm, colours, label = Normalize(0.0, 1.0), confidence_colours(), CONFIDENCE_LABEL
        values = estimate.confidence
    else:
        norm = disparity_norm(values, estimate.confidence, truth)
        colours, label = disparity_colours(), DISPARITY_LABEL
    axes = _axes(axes)
    axes.imshow(values, cmap=colours, norm=norm, interpolation="nearest")
    extend = "both" if quantity == "error" else colourbar_extend(norm, np.asarray(values))
    axes.figure.colorbar(
        ScalarMappable(norm, colours), ax=axes, label=label, ticks=ticks, extend=extend
    )
    axes.set_title(quantity.capitalize())
    axes.set_axis_off()
    return axes


def _axes(axes: Axes | None) -> Axes:
    """Return the given axes, or those of a new figure."""
    return plt.subplots(layout="constrained")[1] if axes is None else axes
