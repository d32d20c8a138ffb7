"""Convolution by minimal filtering and its kernel gradient against NumPy loops."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.minimal_filtering import (
    convolve_rows,
    kernel_gradient_of_rows,
    rows_between_zeros,
)


def by_loops(volume, kernel):
    """``[h, d, w, c]`` and ``[3, 3, 3, c, k]`` over candidates, rows, columns; zero padding."""
    h, d, w, _ = volume.shape
    padded = np.pad(volume, ((1, 1), (1, 1), (1, 1), (0, 0)))
    result = np.zeros((h, d, w, kernel.shape[-1]))
    for depth, row, column in np.ndindex(3, 3, 3):
        part = padded[row : row + h, depth : depth + d, column : column + w]
        result += part @ kernel[depth, row, column]
    return result


def convolve(volume, kernel):
    read = rows_between_zeros(jnp.pad(volume, ((1, 1), (0, 0), (0, 0), (0, 0))))
    return convolve_rows(read, len(volume), kernel, lambda rows, start: rows)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("height", [4, 5, 7, 8, 11])
def test_value_and_kernel_gradient_match_loops(height, tolerance):
    generator = np.random.default_rng(height)
    volume, kernel, gradient = (
        generator.normal(size=shape)
        for shape in ((height, 3, 5, 2), (3, 3, 3, 2, 4), (height, 3, 5, 4))
    )
    result = convolve(jnp.asarray(volume), jnp.asarray(kernel))
    np.testing.assert_allclose(result[1:-1], by_loops(volume, kernel), **tolerance("float64"))
    assert not np.any(result[jnp.array([0, -1])])
    found = kernel_gradient_of_rows(jnp.asarray(volume), jnp.asarray(gradient))
    for index in np.ndindex(found.shape):
        unit = np.zeros(found.shape)
        unit[index] = 1.0
        expected = (gradient * by_loops(volume, unit)).sum()
        np.testing.assert_allclose(found[index], expected, **tolerance("float64"))


def test_finish_gets_the_number_of_the_first_row():
    volume = jnp.zeros((9, 2, 3, 1))
    kernel = jnp.zeros((3, 3, 3, 1, 1))

    def number(rows, start):
        return rows + (start + jnp.arange(4))[:, None, None, None].astype(rows.dtype)

    result = convolve_rows(rows_between_zeros(volume), 7, kernel, number)
    np.testing.assert_array_equal(result[1:-1, 0, 0, 0], np.arange(7))


def test_rounding_error_is_a_few_times_that_of_a_direct_convolution():
    generator = np.random.default_rng(0)
    volume = generator.normal(size=(8, 9, 12, 48)).astype(np.float32)
    kernel = generator.normal(size=(3, 3, 3, 48, 8)).astype(np.float32)
    exact = by_loops(volume.astype(np.float64), kernel.astype(np.float64))
    error = np.asarray(convolve(jnp.asarray(volume), jnp.asarray(kernel)))[1:-1] - exact
    assert np.sqrt(np.mean(error**2)) < 2e-6 * exact.std()
