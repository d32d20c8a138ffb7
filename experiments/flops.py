"""Parameters and floating-point operations of every layer of a network, by formula.

The formula counts, for one light field:

* convolutions and dense layers, with two operations for each multiply-add;
* for each value of a layer's output: two operations for BatchNorm (scale and offset, as at
  inference), and one each for ReLU, a residual sum, a bias and the product with the attention.

It omits sampling (shifts, warps, pooling, upsampling), occlusion weights, means and the regression,
which are less than a hundredth of the paper's networks. The features of all views count, and so do
products with zero padding. With these rules the formula reproduces all FLOPs of the paper's tables
2 and 3 to the printed digits (``python -m experiments.efficiency_table``).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import NamedTuple

from occjax.errors import InputError
from occjax.models import FeatureConfig, OccCasNetConfig, StageConfig


class Layer(NamedTuple):
    """Parameters and operations of one layer.

    Attributes:
        name: Path of its variables in the network.
        parameters: Number of its values, including the statistics of BatchNorm as in the paper;
            zero if an earlier layer with the same weights has been counted.
        multiply_adds: Multiply-adds of its convolution or dense layer.
        others: Elementwise operations: normalisation, ReLU, sums, products.
    """

    name: str
    parameters: int
    multiply_adds: int
    others: int

    @property
    def flops(self) -> int:
        """Number of operations; a multiply-add counts as two."""
        return 2 * self.multiply_adds + self.others


def count_parameters(config: OccCasNetConfig) -> int:
    """Count the values of a network, including the statistics of BatchNorm as in the paper.

    Args:
        config: The network.

    Returns:
        Number of values.

    Example:
        >>> from occjax.models import preset
        >>> count_parameters(preset("occcasnet"))
        4792658
    """
    return sum(layer.parameters for layer in layers(config, (1, 1)))


def count_flops(
    config: OccCasNetConfig, image_size: tuple[int, int] = (256, 256), *, padding: bool = True
) -> int:
    """Count the floating-point operations of an estimate of one light field.

    Args:
        config: The network.
        image_size: ``(H, W)`` of the views, in pixels; by default that of the paper.
        padding: Count products with zero padding, as the paper does; XLA's analysis omits them.

    Returns:
        Number of operations.

    Raises:
        InputError: If the image is empty.

    Example:
        >>> from occjax.models import preset
        >>> f"{count_flops(preset('occcasnet')) / 1e12:.1f} T"
        '13.2 T'
    """
    return sum(layer.flops for layer in layers(config, image_size, padding=padding))


def layers(
    config: OccCasNetConfig, image_size: tuple[int, int], *, padding: bool = True
) -> tuple[Layer, ...]:
    """Return parameters and operations of every layer, in the order of computation.

    Args:
        config: The network.
        image_size: ``(H, W)`` of the views, in pixels.
        padding: Count products with zero padding.

    Returns:
        The layers, for one light field.

    Raises:
        InputError: If the image is empty.

    Example:
        >>> from occjax.models import preset
        >>> first = layers(preset("tiny"), (8, 8))[0]  # 9 views of 64 pixels, 9 taps, 4 channels
        >>> first.name, first.multiply_adds == 9 * 64 * 9 * 4
        ('features/stem_0', True)
    """
    if min(image_size) < 1:
        raise InputError(
            f"the image must have one pixel or more, not {image_size[0]}x{image_size[1]}"
        )
    done = list(_features(config.features, prod(config.views), image_size, padding))
    for index, stage in enumerate(config.stages):
        shared = config.shared_aggregation and index > 0
        part = 0 if config.shared_aggregation else index
        for layer in _stage(config, stage, part, image_size, padding):
            done.append(layer._replace(parameters=0) if shared else layer)
    return tuple(done)


def _features(
    config: FeatureConfig, views: int, image_size: tuple[int, int], padding: bool
) -> Iterator[Layer]:
    """Yield the layers of the feature network on all views."""

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
            # ReLU follows the first convolution, the sum with the shortcut follows the second.
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
    config: OccCasNetConfig,
    stage: StageConfig,
    part: int,
    image_size: tuple[int, int],
    padding: bool,
) -> Iterator[Layer]:
    """Yield the layers of a stage's attention and aggregation; ``part`` numbers its weights."""
    grid = config.views
    # Channels of the volume: mean and variance over the views, their correlation in groups of
    # channels, or the features of each view.
    channels = config.features.channels
    depth = {"statistics": 2 * channels, "correlation": config.correlation_groups}.get(
        stage.volume, prod(grid) * channels
    )
    shape = (len(stage.candidates), *image_size)
    if stage.attention:
        side, hidden = grid[0] // 2 + 1, config.attention_width
        octant = side * (side + 1) // 2
        name = f"attention_{part}"
        yield Layer(f"{name}/hidden", (depth + 1) * hidden, depth * hidden, 2 * hidden)
        yield Layer(f"{name}/octant", (hidden + 1) * octant, hidden * octant, octant)
        yield Layer(f"{name}/product", 0, 0, prod(shape) * depth)

    aggregation = stage.aggregation
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
    """Return a convolution and the elementwise operations after it.

    Args:
        name: Name of the layer.
        kernel: Number of taps, input channels and output channels.
        taps: Total number of taps over all pixels.
        results: Number of output values.
        norm: Whether BatchNorm follows.
        values: Number of other operations on each output value.
    """
    size, channels_in, channels = kernel
    return Layer(
        name,
        parameters=size * channels_in * channels + (4 * channels if norm else 0),
        multiply_adds=taps * channels_in * channels,
        others=(2 * norm + values) * results,
    )


def _taps(shape: tuple[int, ...], kernel: tuple[int, ...], dilation: int, padding: bool) -> int:
    """Count the taps of a kernel over all pixels, with or without taps outside the image."""
    if padding:
        return prod(shape) * prod(kernel)
    return prod(
        sum(max(0, length - dilation * abs(tap - taps // 2)) for tap in range(taps))
        for length, taps in zip(shape, kernel, strict=True)
    )
