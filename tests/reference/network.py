"""The published network in NumPy, as the paper describes it, in float64 by default.

An independent truth for the Flax network: it shares no code with the library and was checked
against activations of the published implementation. It is simple rather than fast: a convolution
is a sum over kernel taps, a volume is a loop over candidates and views.

Weights come as :class:`Weights`, three lists in the order in which the layers are created; widths
follow from the arrays. The published structure is fixed: four groups of residual blocks, spatial
pyramid pooling, and two stages (coarse, refined).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

BLOCKS = (2, 8, 2, 2)
"""Residual blocks in each group of the feature network."""
DILATION = (1, 1, 1, 2)
"""Dilation of both convolutions of each block."""
SHORTCUT = (False, True, True, True)
"""Whether the group's first block has a 1x1 convolution as its shortcut."""
POOLING = (2, 4, 8, 16)
"""Sizes of the spatial pyramid pooling."""
STAGE_NORMALIZATIONS = 7
"""BatchNorms in the aggregation of one stage."""
EPSILON = 1e-3
"""Added to the variance in BatchNorm."""


@dataclass(frozen=True)
class Weights:
    """All weights, in creation order.

    Attributes:
        conv2d: Kernels ``[k, k, in, out]``.
        conv3d: ``(kernel [k, k, k, in, out], bias [out] or None)``.
        batch_normalization: ``(gamma, beta, mean, variance)``, each ``[channels]``.
    """

    conv2d: list[np.ndarray]
    conv3d: list[tuple[np.ndarray, np.ndarray | None]]
    batch_normalization: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]

    @staticmethod
    def from_names(arrays: Mapping[str, np.ndarray], dtype: type = np.float64) -> Weights:
        """Sort arrays named as in the published file, ``.../conv2d_7/kernel:0``.

        Convolutions are computed in the type of the weights.
        """
        layers: dict[str, dict[int, dict[str, np.ndarray]]] = {}
        for name, array in arrays.items():
            layer, weight = name.split("/")[-2:]
            kind, number = re.fullmatch(r"(.+?)(?:_(\d+))?", layer).groups()
            numbered = layers.setdefault(kind, {}).setdefault(int(number or 0), {})
            numbered[weight.removesuffix(":0")] = np.asarray(array, dtype)

        def ordered(kind: str) -> list[dict[str, np.ndarray]]:
            return [layer for _, layer in sorted(layers[kind].items())]

        statistics = ("gamma", "beta", "moving_mean", "moving_variance")
        return Weights(
            conv2d=[layer["kernel"] for layer in ordered("conv2d")],
            conv3d=[(layer["kernel"], layer.get("bias")) for layer in ordered("conv3d")],
            batch_normalization=[
                tuple(layer[name] for name in statistics)
                for layer in ordered("batch_normalization")
            ],
        )

    def coarse(self) -> tuple[Iterator, Iterator, Iterator]:
        """Iterators over kernels, 3-D kernels, BatchNorms of the features and the first stage."""
        half = len(self.conv3d) // 2
        normalization = self.batch_normalization[:-STAGE_NORMALIZATIONS]
        return iter(self.conv2d), iter(self.conv3d[:half]), iter(normalization)

    def refined(self) -> tuple[Iterator, Iterator, Iterator]:
        """The same of the second stage, which has no 2-D convolutions."""
        half = len(self.conv3d) // 2
        normalization = self.batch_normalization[-STAGE_NORMALIZATIONS:]
        return iter(()), iter(self.conv3d[half:]), iter(normalization)


def coarse_stage(
    weights: Weights, light_field: np.ndarray, candidates: np.ndarray
) -> dict[str, np.ndarray]:
    """Features and first disparity of ``[V, U, H, W]`` grey views in [0, 1], V = U odd.

    Args:
        weights: See :class:`Weights`.
        light_field: ``[V, U, H, W]``.
        candidates: ``[D]`` disparities.

    Returns:
        ``features [V, U, H, W, C]``, ``feature_center [H, W, C]``, ``coarse_volume
        [D, H, W, V * U * C]`` (before attention), ``attention_coarse [n]``, ``coarse_prob
        [H, W, D]`` and ``disparity_coarse [H, W]``; the published activations have these names.
    """
    light_field = np.asarray(light_field, np.float64)
    v, u, h, w = light_field.shape
    conv2d, conv3d, normalization = weights.coarse()
    features = extract_features(light_field.reshape(v * u, h, w, 1), conv2d, normalization)
    features = features.reshape(v, u, *features.shape[1:])
    volume = coarse_volume(features, candidates)
    attention, probability = aggregate(volume, (v, u), conv3d, normalization)
    assert not [*conv2d, *conv3d, *normalization], "weights are left over"
    return {
        "features": features,
        "feature_center": features[v // 2, u // 2],
        "coarse_volume": volume,
        "attention_coarse": attention,
        "coarse_prob": probability,
        "disparity_coarse": probability @ candidates,
    }


def refined_stage(
    weights: Weights,
    light_field: np.ndarray,
    first: dict[str, np.ndarray],
    candidates: np.ndarray,
    *,
    transposed: bool,
) -> dict[str, np.ndarray]:
    """Second disparity.

    Args:
        weights: See :class:`Weights`.
        light_field: ``[V, U, H, W]``.
        first: What :func:`coarse_stage` returns.
        candidates: ``[D]`` disparities relative to the first.
        transposed: Exchange row and column displacement in both warps, as the published code does.

    Returns:
        ``occlusion_weight [V, U, H, W]``, ``refined_volume [D, H, W, V * U * C]`` (before
        attention), ``attention_refined [n]``, ``refined_prob [H, W, D]``, ``disparity_refined
        [H, W]``.
    """
    light_field = np.asarray(light_field, np.float64)
    _, conv3d, normalization = weights.refined()
    coarse = first["disparity_coarse"]
    occlusion = occlusion_weight(light_field, coarse, transposed)
    volume = refined_volume(first["features"], coarse, candidates, occlusion, transposed)
    attention, probability = aggregate(volume, light_field.shape[:2], conv3d, normalization)
    assert not [*conv3d, *normalization], "weights are left over"
    return {
        "occlusion_weight": occlusion,
        "refined_volume": volume,
        "attention_refined": attention,
        "refined_prob": probability,
        "disparity_refined": coarse + probability @ candidates,
    }


def convolve(x: np.ndarray, kernel: np.ndarray, dilation: int = 1) -> np.ndarray:
    """Correlate the last axes before the channels with a kernel, zeros outside: ``[..., out]``."""
    taps = kernel.shape[:-2]
    size = x.shape[-1 - len(taps) : -1]
    margin = [dilation * (tap // 2) for tap in taps]
    padded = np.pad(
        x.astype(kernel.dtype, copy=False),
        [(0, 0)] * (x.ndim - 1 - len(taps)) + [(m, m) for m in margin] + [(0, 0)],
    )
    result = np.zeros((x.size // x.shape[-1], kernel.shape[-1]), kernel.dtype)
    for tap in np.ndindex(*taps):
        window = tuple(
            slice(dilation * t, dilation * t + n) for t, n in zip(tap, size, strict=True)
        )
        result += padded[(..., *window, slice(None))].reshape(-1, x.shape[-1]) @ kernel[tap]
    return result.reshape(*x.shape[:-1], kernel.shape[-1])


def normalize(x: np.ndarray, normalization: Iterator) -> np.ndarray:
    """BatchNorm with stored statistics."""
    gamma, beta, mean, variance = next(normalization)
    return gamma * (x - mean) / np.sqrt(variance + EPSILON) + beta


def relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0.0)


def extract_features(views: np.ndarray, conv2d: Iterator, normalization: Iterator) -> np.ndarray:
    """Shared feature network: ``[N, H, W, 1]`` views to ``[N, H, W, C]`` features."""
    x = relu(normalize(convolve(views, next(conv2d)), normalization))
    x = relu(normalize(convolve(x, next(conv2d)), normalization))
    groups = []
    for blocks, dilation, has_shortcut in zip(BLOCKS, DILATION, SHORTCUT, strict=True):
        for block in range(blocks):
            shortcut = x
            if block == 0 and has_shortcut:
                shortcut = normalize(convolve(x, next(conv2d)), normalization)
            x = relu(normalize(convolve(x, next(conv2d), dilation), normalization))
            x = normalize(convolve(x, next(conv2d), dilation), normalization) + shortcut
        groups.append(x)
    pyramid = []
    for size in POOLING:
        branch = relu(normalize(convolve(average_pool(x, size), next(conv2d)), normalization))
        pyramid.append(resize(branch, x.shape[1:3]))
    x = np.concatenate([groups[1], groups[3], *reversed(pyramid)], axis=-1)
    x = relu(normalize(convolve(x, next(conv2d)), normalization))
    return convolve(x, next(conv2d))


def average_pool(x: np.ndarray, size: int) -> np.ndarray:
    """Mean over tiles of ``[N, H, W, C]``; where tiles overhang the image, over what is inside.

    The overhang is shared by both sides; the far side gets the odd pixel.
    """
    h, w = x.shape[1:3]
    rows, columns = -(-h // size), -(-w // size)
    top, left = (rows * size - h) // 2, (columns * size - w) // 2
    result = np.empty((x.shape[0], rows, columns, x.shape[3]))
    for i, j in np.ndindex(rows, columns):
        y, z = i * size - top, j * size - left
        tile = x[:, max(y, 0) : y + size, max(z, 0) : z + size]
        result[:, i, j] = tile.mean(axis=(1, 2))
    return result


def resize(x: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Bilinear upsampling of ``[N, h, w, C]`` that keeps the corner pixels in the corners."""

    def interpolation(source: int, target: int) -> np.ndarray:
        matrix = np.zeros((target, source))
        for i in range(target):
            position = i * (source - 1) / (target - 1) if target > 1 else 0.0
            base = min(int(position), max(source - 2, 0))
            matrix[i, base] += 1.0 - (position - base)
            if source > 1:
                matrix[i, base + 1] += position - base
        return matrix

    rows = interpolation(x.shape[1], size[0])
    columns = interpolation(x.shape[2], size[1])
    return np.einsum("yh,xw,nhwc->nyxc", rows, columns, x, optimize=True)


def coarse_volume(features: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """``[D, H, W, V * U * C]``: every view shifted by every candidate, channels view by view.

    A view's point at ``(y - d (v - v0), x - d (u - u0))``, zero outside the image.
    """
    v, u, h, w, c = features.shape
    y, x = np.mgrid[:h, :w].astype(float)
    volume = np.empty((len(candidates), h, w, v, u, c))
    for k, i, j in np.ndindex(len(candidates), v, u):
        row, column = y - candidates[k] * (i - v // 2), x - candidates[k] * (j - u // 2)
        volume[k, :, :, i, j] = sample_zero(features[i, j], row, column)
    return volume.reshape(len(candidates), h, w, v * u * c)


def refined_volume(
    features: np.ndarray,
    coarse: np.ndarray,
    candidates: np.ndarray,
    weight: np.ndarray,
    transposed: bool,
) -> np.ndarray:
    """``[D, H, W, V * U * C]``: views warped by coarse disparity plus candidate, then weighted."""
    v, u, h, w, c = features.shape
    volume = np.empty((len(candidates), h, w, v, u, c))
    for k, i, j in np.ndindex(len(candidates), v, u):
        row, column = positions(coarse + candidates[k], i - v // 2, j - u // 2, transposed)
        warped = sample_replicate(features[i, j], row, column)
        volume[k, :, :, i, j] = warped * weight[i, j, :, :, None]
    return volume.reshape(len(candidates), h, w, v * u * c)


def occlusion_weight(light_field: np.ndarray, disparity: np.ndarray, transposed: bool):
    """``[V, U, H, W]``: squared agreement of each warped view with the centre view."""
    v, u = light_field.shape[:2]
    centre = light_field[v // 2, u // 2]
    weight = np.empty_like(light_field)
    for i, j in np.ndindex(v, u):
        row, column = positions(disparity, i - v // 2, j - u // 2, transposed)
        warped = sample_replicate(light_field[i, j, :, :, None], row, column)[..., 0]
        weight[i, j] = (1.0 - np.clip(np.abs(warped - centre), 0.0, 1.0)) ** 2
    return weight


def positions(disparity: np.ndarray, rows: int, columns: int, transposed: bool):
    """Where the view ``rows`` below and ``columns`` right of the centre sees each centre pixel."""
    if transposed:
        rows, columns = columns, rows
    y, x = np.mgrid[: disparity.shape[0], : disparity.shape[1]]
    return y - disparity * rows, x - disparity * columns


def sample_zero(image: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Bilinear ``[H, W, C]``; the image is zero outside."""
    h, w = image.shape[:2]
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    result = np.zeros_like(image)
    for i, j in np.ndindex(2, 2):
        y, x = top + i, left + j
        weight = (1.0 - np.abs(row - y)) * (1.0 - np.abs(column - x))
        inside = (y >= 0) & (y < h) & (x >= 0) & (x < w)
        result[inside] += weight[inside, None] * image[y[inside], x[inside]]
    return result


def sample_replicate(image: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Bilinear ``[H, W, C]``; base tap clamped to [0, size - 2] and fraction to [0, 1]."""
    h, w = image.shape[:2]
    top = np.clip(np.floor(row), 0, h - 2).astype(int)
    left = np.clip(np.floor(column), 0, w - 2).astype(int)
    down = np.clip(row - top, 0.0, 1.0)[..., None]
    right = np.clip(column - left, 0.0, 1.0)[..., None]
    return (
        (1.0 - down) * (1.0 - right) * image[top, left]
        + (1.0 - down) * right * image[top, left + 1]
        + down * (1.0 - right) * image[top + 1, left]
        + down * right * image[top + 1, left + 1]
    )


def aggregate(
    volume: np.ndarray, grid: tuple[int, int], conv3d: Iterator, normalization: Iterator
) -> tuple[np.ndarray, np.ndarray]:
    """One stage from volume ``[D, H, W, V * U * C]`` to attention ``[n]`` and ``[H, W, D]``."""
    attention = view_attention(volume, conv3d)
    per_view = mirror(attention, grid)
    x = volume * np.repeat(per_view.ravel(), volume.shape[-1] // per_view.size)

    def layer(x: np.ndarray) -> np.ndarray:
        return normalize(convolve(x, next(conv3d)[0]), normalization)

    x = relu(layer(relu(layer(x))))
    for _ in range(2):
        inner = relu(layer(x))
        x = layer(inner) + x
    x = relu(layer(x))
    output = np.moveaxis(convolve(x, next(conv3d)[0])[..., 0], 0, -1)
    exponential = np.exp(output - output.max(axis=-1, keepdims=True))
    return attention, exponential / exponential.sum(axis=-1, keepdims=True)


def view_attention(volume: np.ndarray, conv3d: Iterator) -> np.ndarray:
    """The ``[n]`` distinct weights of views, from the mean of each channel."""
    (first, first_bias), (second, second_bias) = next(conv3d), next(conv3d)
    hidden = relu(volume.mean(axis=(0, 1, 2)) @ first[0, 0, 0] + first_bias)
    return 1.0 / (1.0 + np.exp(-(hidden @ second[0, 0, 0] + second_bias)))


def mirror(attention: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """``[V, U]``: a symmetric matrix from its upper triangle, reflected about its last entries."""
    half = (grid[0] + 1) // 2
    quadrant = np.empty((half, half))
    values = iter(attention)
    for i in range(half):
        for j in range(i, half):
            quadrant[i, j] = quadrant[j, i] = next(values)
    return np.pad(quadrant, (0, half - 1), mode="reflect")
