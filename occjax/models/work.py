"""How much work a network is: parameters and operations of every layer, by formula.

What is counted, per light field:

* convolutions and dense layers, each multiply-add as two operations;
* for every value of a layer's result, BatchNorm as two (a factor and a term, as at inference), and
  ReLU, a residual sum, a bias and the product with the attention as one each.

Sampling (shifts, warps, pooling, upsampling), occlusion weights, means and the regression are left
out, less than a hundredth in the networks of the paper. Counted like this, all FLOPs in its
tables 2 and 3 come out to the printed digits (``python -m experiments.efficiency_table``): the
features of all views count, and so do products with the zeros around an image.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import NamedTuple

from occjax.errors import InputError
from occjax.models.config import FeatureConfig, NetworkConfig, Residual, StageConfig, of_kind


class Layer(NamedTuple):
    """Work of one layer.

    Attributes:
        name: Path of its variables, as in the network.
        parameters: Values it has, statistics of BatchNorm included as in the paper; zero for a
            layer whose weights another one has been counted for.
        multiply_adds: Of its convolution or dense layer.
        others: Operations on single values: normalisation, ReLU, sums, products.
    """

    name: str
    parameters: int
    multiply_adds: int
    others: int

    @property
    def flops(self) -> int:
        """Operations, a multiply-add as two."""
        return 2 * self.multiply_adds + self.others


def count_parameters(config: NetworkConfig) -> int:
    """Values of a network, statistics of BatchNorm included as in the paper.

    Args:
        config: A network of a grid of views.

    Returns:
        Their number.

    Raises:
        InputError: If the network is one for any arrangement of views.

    Example:
        >>> from occjax.models import preset
        >>> count_parameters(preset("occcasnet"))
        4792658
    """
    return sum(layer.parameters for layer in layers(config, (1, 1)))


def count_flops(
    config: NetworkConfig, image_size: tuple[int, int] = (256, 256), *, padding: bool = True
) -> int:
    """Floating-point operations of estimating one light field.

    Args:
        config: A network of a grid of views.
        image_size: ``(H, W)`` pixels; the paper's by default.
        padding: Whether products with the zeros around an image count, as in the paper; XLA's
            analysis leaves them out.

    Returns:
        Their number.

    Raises:
        InputError: If the network is one for any arrangement of views, or the image is empty.

    Example:
        >>> from occjax.models import preset
        >>> f"{count_flops(preset('occcasnet')) / 1e12:.1f} T"
        '13.2 T'
    """
    return sum(layer.flops for layer in layers(config, image_size, padding=padding))


def layers(
    config: NetworkConfig, image_size: tuple[int, int], *, padding: bool = True
) -> tuple[Layer, ...]:
    """Work of every layer for one light field, in the order of computation.

    Args:
        config: A network of a grid of views.
        image_size: ``(H, W)`` pixels.
        padding: Whether products with the zeros around an image count.

    Returns:
        The layers.

    Raises:
        InputError: If the network is one for any arrangement of views, or the image is empty.

    Example:
        >>> from occjax.models import preset
        >>> first = layers(preset("tiny"), (8, 8))[0]  # 9 views of 64 pixels, 9 taps, 4 channels
        >>> first.name, first.multiply_adds == 9 * 64 * 9 * 4
        ('features/stem_0', True)
    """
    if config.views is None:
        raise InputError(
            "work is counted of networks of a grid of views; this one takes any arrangement"
        )
    if min(image_size) < 1:
        raise InputError(f"an image has one pixel or more, not {image_size[0]}x{image_size[1]}")
    features = of_kind(config.features, FeatureConfig)
    done = list(_features(features, prod(config.views), image_size, padding))
    for index, stage in enumerate(config.stages):
        shared = config.shared_aggregation and index > 0
        part = 0 if config.shared_aggregation else index
        for layer in _stage(config, stage, part, image_size, padding):
            done.append(layer._replace(parameters=0) if shared else layer)
    return tuple(done)


def _features(
    config: FeatureConfig, views: int, image_size: tuple[int, int], padding: bool
) -> Iterator[Layer]:
    """The feature network on all views, layer by layer."""

    def convolution(
        name, channels_in, channels, *, side=3, dilation=1, norm=True, values=0, size=image_size
    ):
        taps = views * _taps(size, (side, side), dilation, padding)
        return _convolution(
            f"features/{name}",
            (side**2, channels_in, channels),
            taps,
            views * prod(size) * channels,
            norm=norm,
            values=values,
        )

    yield convolution("stem_0", 1, config.stem, values=1)
    yield convolution("stem_1", config.stem, config.stem, values=1)
    width = config.stem
    for group, (channels, blocks, dilation) in enumerate(
        zip(config.widths, config.blocks, config.dilations, strict=True)
    ):
        for block in range(blocks):
            name = f"group_{group}_block_{block}"
            if group > 0 and block == 0:
                yield convolution(f"{name}/shortcut", width, channels, side=1)
            # ReLU after the first convolution, the sum with the shortcut after the second.
            for half in range(2):
                yield convolution(
                    f"{name}/conv_{half}", width, channels, dilation=dilation, values=1
                )
                width = channels
    for side in config.pooled:
        pooled = tuple(-(-length // side) for length in image_size)
        yield convolution(
            f"pooled_{side}", width, config.pooled_width, side=1, values=1, size=pooled
        )
    joined = config.widths[1] + width + len(config.pooled) * config.pooled_width
    yield convolution("fused", joined, config.fused, values=1)
    yield convolution("output", config.fused, config.channels, side=1, norm=False)


def _stage(
    config: NetworkConfig,
    stage: StageConfig,
    part: int,
    image_size: tuple[int, int],
    padding: bool,
) -> Iterator[Layer]:
    """Attention and aggregation of a stage; ``part`` numbers its weights."""
    grid = of_kind(config.views, tuple)
    # Mean and variance, or the features of each view.
    planes = 2 if stage.volume == "statistics" else prod(grid)
    depth = planes * of_kind(config.features, FeatureConfig).channels
    shape = (len(stage.candidates), *image_size)
    if stage.attention:
        side, hidden = grid[0] // 2 + 1, config.attention_width
        octant = side * (side + 1) // 2
        name = f"attention_{part}"
        yield Layer(f"{name}/hidden", (depth + 1) * hidden, depth * hidden, 2 * hidden)
        yield Layer(f"{name}/octant", (hidden + 1) * octant, hidden * octant, octant)
        yield Layer(f"{name}/product", 0, 0, prod(shape) * depth)

    aggregation = of_kind(stage.aggregation, Residual)
    width, taps = aggregation.width, _taps(shape, (3, 3, 3), 1, padding)
    pairs = [f"pair_{pair}_conv_{half}" for pair in range(aggregation.pairs) for half in (0, 1)]
    for name in ("conv_0", "conv_1", *pairs, "conv_2", "score"):
        channels = 1 if name == "score" else width
        yield _convolution(
            f"aggregation_{part}/{name}",
            (27, depth, channels),
            taps,
            prod(shape) * channels,
            norm=name != "score",
            values=int(name != "score"),
        )
        depth = channels


def _convolution(
    name: str, kernel: tuple[int, int, int], taps: int, results: int, *, norm: bool, values: int
) -> Layer:
    """A convolution and what is done to each of its results after it.

    Args:
        name: Of the layer.
        kernel: Taps, channels that go in, channels that come out.
        taps: Taps of all pixels together.
        results: Values that come out.
        norm: Whether BatchNorm follows.
        values: Further operations on each result.
    """
    size, channels_in, channels = kernel
    return Layer(
        name,
        parameters=size * channels_in * channels + (4 * channels if norm else 0),
        multiply_adds=taps * channels_in * channels,
        others=(2 * norm + values) * results,
    )


def _taps(shape: tuple[int, ...], kernel: tuple[int, ...], dilation: int, padding: bool) -> int:
    """Taps of a kernel at all pixels, with or without those that lie outside the image."""
    if padding:
        return prod(shape) * prod(kernel)
    return prod(
        sum(max(0, length - dilation * abs(tap - taps // 2)) for tap in range(taps))
        for length, taps in zip(shape, kernel, strict=True)
    )
