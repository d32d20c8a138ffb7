"""The convolution of volumes against loops, its gradients against XLA's 3-D convolution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models.volume_convolution import WIDE, VolumeConv, convolve_volume


def convolve_by_loops(volume, kernel):
    padded = np.pad(volume, ((1, 1), (1, 1), (1, 1), (0, 0)))
    d, h, w, _ = volume.shape
    result = np.zeros((d, h, w, kernel.shape[-1]))
    for i, j, k in np.ndindex(3, 3, 3):
        result += padded[i : i + d, j : j + h, k : k + w] @ kernel[i, j, k]
    return result


@pytest.mark.parametrize("depth", [1, 2, 5])
def test_volume_convolution_is_the_three_dimensional_one(depth, tolerance):
    generator = np.random.default_rng(0)
    volume = generator.normal(size=(depth, 4, 5, 3)).astype(np.float32)
    kernel = generator.normal(size=(3, 3, 3, 3, 2)).astype(np.float32)
    result = VolumeConv(2).apply({"params": {"kernel": jnp.asarray(kernel)}}, jnp.asarray(volume))
    np.testing.assert_allclose(result, convolve_by_loops(volume, kernel), **tolerance("float32"))


def in_three_dimensions(volumes, kernel):
    """Of a batch of volumes, by XLA."""
    layout = ("NDHWC", "DHWIO", "NDHWC")
    return jax.lax.conv_general_dilated(
        volumes, kernel, (1, 1, 1), "SAME", dimension_numbers=layout
    )


def draw(*shapes):
    generator = np.random.default_rng(2)
    return [jnp.asarray(generator.normal(size=shape), jnp.float32) for shape in shapes]


@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("channels", [(3, 2), (WIDE, 1), (WIDE, WIDE + 1)])
@pytest.mark.parametrize("size", [(1, 4, 5), (2, 3, 4), (5, 6, 3)])
def test_value_and_gradients_are_those_in_three_dimensions(size, channels, tolerance):
    volumes, kernel, weights = draw(
        (2, *size, channels[0]), (3, 3, 3, *channels), (2, *size, channels[1])
    )
    kernel = kernel / channels[0]

    def weighted(convolve):
        def total(volumes, kernel):
            result = convolve(volumes, kernel)
            return (weights * result).sum(), result

        return jax.jit(jax.value_and_grad(total, (0, 1), has_aux=True))

    batch = jax.vmap(convolve_volume, (0, None))
    ((_, value), gradients), ((_, expected), exact) = (
        weighted(convolve)(volumes, kernel) for convolve in (batch, in_three_dimensions)
    )
    for one, other in zip((value, *gradients), (expected, *exact), strict=True):
        scale = float(jnp.abs(other).max())
        np.testing.assert_allclose(one / scale, other / scale, **tolerance("float32"))


def test_on_a_gpu_a_batch_is_one_convolution_and_so_is_each_gradient():
    volumes = jax.ShapeDtypeStruct((2, 5, 6, 7, 12), jnp.bfloat16)
    kernel = jax.ShapeDtypeStruct((3, 3, 3, 12, 16), jnp.bfloat16)

    def total(volumes, kernel):
        return jnp.square(jax.vmap(convolve_volume, (0, None))(volumes, kernel)).sum()

    traced = jax.jit(jax.grad(total, (0, 1))).trace(volumes, kernel)
    text = traced.lower(lowering_platforms=("cuda",)).as_text()
    lines = [line for line in text.splitlines() if "stablehlo.convolution" in line]
    # Channels of the volume are padded to 16, those of the three planes are 48.
    volume, planes, kernels = "10x6x7x16xbf16", "10x6x7x48xbf16", "3x3x16x48xbf16"
    sides = [line.rsplit(": ", 1)[1] for line in lines]
    assert sorted(sides) == sorted(
        f"(tensor<{one}>, tensor<{other}>) -> tensor<{result}>"
        for one, other, result in (
            (volume, kernels, planes),
            (planes, kernels, volume),
            (volume, planes, kernels),
        )
    )


def test_gradients_of_half_precision_are_summed_in_single():
    volume, kernel, weights = draw((40, 8, 8, 2), (3, 3, 3, 2, 2), (40, 8, 8, 2))
    half = [each.astype(jnp.bfloat16) for each in (volume, kernel, weights)]

    def gradient(volume, kernel, weights):
        return jax.vjp(lambda kernel: convolve_volume(volume, kernel), kernel)[1](weights)[0]

    found = jax.jit(gradient)(*half)
    exact = jax.jit(gradient)(*(each.astype(jnp.float32) for each in half))
    assert found.dtype == jnp.bfloat16
    # Sums of 2560 terms in bfloat16 would be off by more than the last rounding.
    np.testing.assert_allclose(np.float32(found), exact, rtol=2**-8)


@pytest.mark.parametrize("channels", [2, WIDE])
@pytest.mark.parametrize("size", [(0, 5, 4), (3, 0, 4), (3, 5, 0)])
def test_no_voxels_have_a_gradient_of_zero(size, channels):
    volume, kernel = jnp.zeros((*size, channels)), jnp.ones((3, 3, 3, channels, channels))
    found = jax.grad(lambda kernel: convolve_volume(volume, kernel).sum())(kernel)
    np.testing.assert_array_equal(found, np.zeros(kernel.shape))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("size", [(5, 3, 3), (1, 3, 3), (3, 5, 5)])
def test_a_kernel_of_another_size_is_refused(size):
    volume, kernel = jnp.ones((2, 4, 4, 2)), jnp.ones((*size, 2, 3))
    for call in (convolve_volume, jax.grad(lambda *both: convolve_volume(*both).sum())):
        with pytest.raises(ValueError, match="must be 3x3x3"):
            call(volume, kernel)
