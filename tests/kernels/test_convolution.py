"""Two-dimensional convolution and its gradients against NumPy loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.convolution import (
    MAX_NARROW_CHANNELS,
    PACKED_CHANNELS,
    convolve_images,
    kernel_gradient,
    packed_convolution,
)


def by_loops(images, kernel, dilation):
    """``[n, h, w, c]`` and ``[i, j, c, k]``; zero padding."""
    _, h, w, _ = images.shape
    rows, columns = kernel.shape[:2]
    above, left = dilation * (rows // 2), dilation * (columns // 2)
    padded = np.pad(images, ((0, 0), (above, above), (left, left), (0, 0)))
    result = 0.0
    for row, column in np.ndindex(rows, columns):
        part = padded[:, dilation * row :, dilation * column :][:, :h, :w]
        result = result + part @ kernel[row, column]
    return result


def gradient_by_loops(function, shape):
    """Gradient of a linear function: its values for unit arrays."""
    gradient = np.zeros(shape)
    for index in np.ndindex(shape):
        unit = np.zeros(shape)
        unit[index] = 1.0
        gradient[index] = function(unit)
    return gradient


def normal(seed, *shapes):
    generator = np.random.default_rng(seed)
    return [generator.normal(size=shape) for shape in shapes]


@pytest.mark.usefixtures("platform", "x64")
@pytest.mark.parametrize("dilation", [1, 2])
@pytest.mark.parametrize("size", [(1, 1), (3, 3), (5, 3)])
def test_value_and_gradients_match_loops(size, dilation, tolerance):
    images, kernel, weights = normal(1, (2, 5, 4, 2), (*size, 2, 3), (2, 5, 4, 3))

    def total(images, kernel):
        result = convolve_images(images, kernel, dilation)
        return (weights * result).sum(), result

    differentiate = jax.jit(jax.grad(total, (0, 1), has_aux=True))
    (of_images, of_kernel), value = differentiate(jnp.asarray(images), jnp.asarray(kernel))
    np.testing.assert_allclose(value, by_loops(images, kernel, dilation), **tolerance("float64"))
    expected = gradient_by_loops(
        lambda unit: (weights * by_loops(unit, kernel, dilation)).sum(), images.shape
    )
    np.testing.assert_allclose(of_images, expected, **tolerance("float64"))
    expected = gradient_by_loops(
        lambda unit: (weights * by_loops(images, unit, dilation)).sum(), kernel.shape
    )
    np.testing.assert_allclose(of_kernel, expected, **tolerance("float64"))


@pytest.mark.parametrize("width", [8, 9, 2])
@pytest.mark.parametrize("per_block", [4, 2, 1])
@pytest.mark.parametrize("dilation", [1, 2])
def test_packed_channels_match_loops(per_block, width, dilation, tolerance):
    channels = PACKED_CHANNELS // per_block + (per_block == 4)
    images, kernel = normal(4, (2, 3, width, 3), (3, 3, 3, channels))
    found = packed_convolution(jnp.asarray(images), jnp.asarray(kernel), dilation)
    np.testing.assert_allclose(
        found, by_loops(images, kernel, dilation), **tolerance("convolution")
    )


@pytest.mark.usefixtures("x64")
def test_wide_and_narrow_results_have_the_same_kernel_gradient(tolerance):
    narrow = MAX_NARROW_CHANNELS
    image, gradient = map(jnp.asarray, normal(2, (6, 5, 3), (6, 5, narrow + 1)))
    wide = kernel_gradient(image, gradient, (3, 5), 2)
    for first in (0, 1):
        found = kernel_gradient(image, gradient[..., first : first + narrow], (3, 5), 2)
        np.testing.assert_allclose(wide[..., first : first + narrow], found, **tolerance("float64"))


def test_half_precision_gradients_are_summed_in_single_precision(tolerance):
    image, gradient = (jnp.asarray(a, jnp.bfloat16) for a in normal(3, *[(50, 50, 2)] * 2))
    found = kernel_gradient(image, gradient, (3, 3))
    exact = kernel_gradient(image.astype(jnp.float32), gradient.astype(jnp.float32), (3, 3))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, exact, **tolerance("float32"))


@pytest.mark.parametrize("shape", [(0, 4, 5, 2), (2, 0, 5, 2), (2, 4, 0, 2), (2, 4, 5, 0)])
@pytest.mark.parametrize("channels", [1, MAX_NARROW_CHANNELS + 1])
def test_empty_images_have_a_gradient_of_zero(shape, channels):
    images, kernel = jnp.zeros(shape), jnp.ones((3, 3, shape[-1], channels))
    found = jax.grad(lambda kernel: convolve_images(images, kernel).sum())(kernel)
    np.testing.assert_array_equal(found, np.zeros(kernel.shape))


def test_kernel_of_even_size_is_refused():
    with pytest.raises(ValueError, match="must be odd"):
        convolve_images(jnp.ones((1, 4, 4, 2)), jnp.ones((2, 3, 2, 3)))
