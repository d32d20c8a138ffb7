"""Gradients of the two-dimensional convolution against loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops.convolution import (
    NARROW,
    PACKED,
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


def gradients_by_loops(images, kernel, weights, dilation):
    """Of ``(weights * convolution).sum()``, which is linear in each: its values for unit arrays."""
    of_images, of_kernel = np.zeros_like(images), np.zeros_like(kernel)
    for index in np.ndindex(kernel.shape):
        unit = np.zeros_like(kernel)
        unit[index] = 1.0
        of_kernel[index] = (weights * by_loops(images, unit, dilation)).sum()
    for index in np.ndindex(images.shape):
        unit = np.zeros_like(images)
        unit[index] = 1.0
        of_images[index] = (weights * by_loops(unit, kernel, dilation)).sum()
    return of_images, of_kernel


@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("dilation", [1, 2])
@pytest.mark.parametrize("size", [(1, 1), (3, 3), (5, 3)])
def test_value_and_gradients_are_those_of_loops(size, dilation, x64):
    generator = np.random.default_rng(1)
    images, kernel, weights = (
        generator.normal(size=shape) for shape in ((2, 5, 4, 2), (*size, 2, 3), (2, 5, 4, 3))
    )

    def total(images, kernel):
        result = convolve_images(images, kernel, dilation)
        return (weights * result).sum(), result

    differentiate = jax.jit(jax.grad(total, (0, 1), has_aux=True))
    found, value = differentiate(jnp.asarray(images), jnp.asarray(kernel))
    np.testing.assert_allclose(value, by_loops(images, kernel, dilation), atol=1e-12)
    for one, other in zip(
        found, gradients_by_loops(images, kernel, weights, dilation), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize("width", [8, 9, 2])
@pytest.mark.parametrize("channels", [PACKED // 2, PACKED // 4, PACKED // 4 + 1, 2 * PACKED])
def test_pixels_side_by_side_are_convolved_as_one_by_one(channels, width):
    generator = np.random.default_rng(4)
    images, kernel = (
        generator.normal(size=shape) for shape in ((2, 3, width, 3), (3, 3, 3, channels))
    )
    for dilation in (1, 2):
        found = packed_convolution(jnp.asarray(images), jnp.asarray(kernel), dilation)
        np.testing.assert_allclose(found, by_loops(images, kernel, dilation), atol=1e-5)


def test_on_a_gpu_few_channels_lie_side_by_side():
    images, kernel = (
        jax.ShapeDtypeStruct(shape, jnp.float32) for shape in ((2, 8, 32, 4), (3, 3, 4, 4))
    )
    traced = jax.jit(convolve_images).trace(images, kernel)
    (line,) = (
        line
        for line in traced.lower(lowering_platforms=("cuda",)).as_text().splitlines()
        if "stablehlo.convolution" in line
    )
    assert "(tensor<2x8x2x64xf32>, tensor<3x3x64x64xf32>) -> tensor<2x8x2x64xf32>" in line


def test_on_a_gpu_the_kernel_of_a_batch_has_one_gradient():
    """Taken for one light field at a time it would be a convolution for each of them."""
    images = jax.ShapeDtypeStruct((5, 2, 8, 8, PACKED), jnp.float32)
    kernel = jax.ShapeDtypeStruct((3, 3, PACKED, PACKED), jnp.float32)

    def total(kernel, images):
        return jax.vmap(convolve_images, (0, None))(images, kernel).sum()

    traced = jax.jit(jax.grad(total)).trace(kernel, images)
    text = traced.lower(lowering_platforms=("cuda",)).as_text()
    assert "tensor<10x8x8x64xf32>, tensor<10x8x8x64xf32>) -> tensor<3x3x64x64xf32>" in text


def test_wide_and_narrow_results_have_the_same_gradient(x64):
    generator = np.random.default_rng(2)
    image, gradient = (
        jnp.asarray(generator.normal(size=shape)) for shape in ((6, 5, 3), (6, 5, NARROW + 1))
    )
    wide = kernel_gradient(image, gradient, (3, 5), 2)
    for first in (0, 1):
        narrow = kernel_gradient(image, gradient[..., first : first + NARROW], (3, 5), 2)
        np.testing.assert_allclose(wide[..., first : first + NARROW], narrow, atol=1e-12)


def test_gradients_of_half_precision_are_summed_in_single():
    generator = np.random.default_rng(3)
    image, gradient = (
        jnp.asarray(generator.normal(size=(50, 50, 2)), jnp.bfloat16) for _ in range(2)
    )
    found = kernel_gradient(image, gradient, (3, 3))
    exact = kernel_gradient(*(each.astype(jnp.float32) for each in (image, gradient)), (3, 3))
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, exact, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("shape", [(0, 4, 5, 2), (2, 0, 5, 2), (2, 4, 0, 2), (2, 4, 5, 0)])
@pytest.mark.parametrize("channels", [1, NARROW + 1])
def test_no_pixels_have_a_gradient_of_zero(shape, channels):
    images, kernel = jnp.zeros(shape), jnp.ones((3, 3, shape[-1], channels))
    found = jax.grad(lambda kernel: convolve_images(images, kernel).sum())(kernel)
    np.testing.assert_array_equal(found, np.zeros(kernel.shape))


def test_a_kernel_without_a_centre_is_refused():
    images, kernel = jnp.ones((1, 4, 4, 2)), jnp.ones((2, 3, 2, 3))
    for call in (convolve_images, jax.grad(lambda *both: convolve_images(*both).sum())):
        with pytest.raises(ValueError, match="must be odd"):
            call(images, kernel)
