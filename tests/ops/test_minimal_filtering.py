"""Convolution row by row is the convolution, with half of the multiplications."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops.minimal_filtering import (
    convolve_rows,
    kernel_gradient_of_rows,
    row_kernels,
    rows_between_zeros,
)


def by_loops(volume, kernel):
    """``[h, d, w, c]`` and ``[3, 3, 3, c, k]`` over candidates, rows, columns; zero padding."""
    h, d, w, _ = volume.shape
    padded = np.pad(volume, ((1, 1), (1, 1), (1, 1), (0, 0)))
    result = np.zeros((h, d, w, kernel.shape[-1]))
    for depth in range(3):
        for row in range(3):
            for column in range(3):
                part = padded[row : row + h, depth : depth + d, column : column + w]
                result += part @ kernel[depth, row, column]
    return result


def convolved(volume, kernel):
    read = rows_between_zeros(jnp.pad(volume, ((1, 1), (0, 0), (0, 0), (0, 0))))
    return convolve_rows(read, len(volume), row_kernels(kernel), lambda rows, start: rows)


@pytest.mark.parametrize("height", [4, 5, 7, 8, 11])
def test_any_height_is_the_convolution(height, x64):
    generator = np.random.default_rng(height)
    volume, kernel = (
        generator.normal(size=(height, 3, 5, 2)),
        generator.normal(size=(3, 3, 3, 2, 4)),
    )
    result = convolved(jnp.asarray(volume), jnp.asarray(kernel))
    np.testing.assert_allclose(result[1:-1], by_loops(volume, kernel), atol=1e-12)
    assert not np.any(result[jnp.array([0, -1])])


@pytest.mark.parametrize("height", [4, 5, 7, 11])
def test_the_gradient_of_the_kernel_is_that_of_the_convolution(height, x64):
    generator = np.random.default_rng(height)
    volume, gradient = (
        generator.normal(size=(height, 3, 5, 2)),
        generator.normal(size=(height, 3, 5, 4)),
    )
    found = kernel_gradient_of_rows(jnp.asarray(volume), jnp.asarray(gradient))
    for index in np.ndindex(found.shape):
        unit = np.zeros(found.shape)
        unit[index] = 1.0
        expected = (gradient * by_loops(volume, unit)).sum()
        np.testing.assert_allclose(found[index], expected, atol=1e-11)


def test_rows_are_finished_once_and_know_their_number():
    volume = jnp.zeros((9, 2, 3, 1))
    kernels = row_kernels(jnp.zeros((3, 3, 3, 1, 1)))

    def number(rows, start):
        return rows + (start + jnp.arange(4))[:, None, None, None].astype(rows.dtype)

    result = convolve_rows(rows_between_zeros(volume), 7, kernels, number)
    np.testing.assert_array_equal(result[1:-1, 0, 0, 0], np.arange(7))


def test_half_of_the_operations_are_left():
    """By XLA's count of the lowered program; four rows, whose loop has one step."""
    shapes = (4, 9, 16, 32), (3, 3, 3, 32, 32)
    volume, kernel = (jax.ShapeDtypeStruct(shape, jnp.float32) for shape in shapes)
    counted = jax.jit(convolved).lower(volume, kernel).cost_analysis()["flops"]
    # Inside the volume: 9 candidates have 25 pairs of neighbours, 16 columns 46, 4 rows 10.
    direct = 2 * (25 * 46 * 10) * 32 * 32
    products = 2 * (25 * 46 * 6) * 32 * 32
    assert products < counted < 0.8 * direct


def test_half_of_the_operations_are_left_for_the_gradient_of_the_kernel():
    """By XLA's count of the lowered program; four rows, whose loop has one step."""
    volume = jax.ShapeDtypeStruct((4, 9, 16, 32), jnp.float32)
    counted = jax.jit(kernel_gradient_of_rows).lower(volume, volume).cost_analysis()["flops"]
    direct = 2 * 27 * (4 * 9 * 16) * 32 * 32
    assert direct / 2 < counted < 0.6 * direct


def test_rounding_is_that_of_a_direct_convolution_times_a_few():
    generator = np.random.default_rng(0)
    volume = generator.normal(size=(8, 9, 12, 48)).astype(np.float32)
    kernel = generator.normal(size=(3, 3, 3, 48, 8)).astype(np.float32)
    exact = by_loops(volume.astype(np.float64), kernel.astype(np.float64))
    error = np.asarray(convolved(jnp.asarray(volume), jnp.asarray(kernel)))[1:-1] - exact
    assert np.sqrt(np.mean(error**2)) < 2e-6 * exact.std()
