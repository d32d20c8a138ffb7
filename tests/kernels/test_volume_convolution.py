"""Convolution of volumes and its gradients against XLA's 3-D convolution."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.volume_convolution import MIN_FILTERED_CHANNELS, convolve_volume

WIDE = MIN_FILTERED_CHANNELS


def by_xla(volumes, kernel):
    """Convolve a batch of volumes."""
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
def test_value_and_gradients_match_xla(size, channels, tolerance):
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
        weighted(convolve)(volumes, kernel) for convolve in (batch, by_xla)
    )
    for one, other in zip((value, *gradients), (expected, *exact), strict=True):
        scale = float(jnp.abs(other).max())
        np.testing.assert_allclose(one / scale, other / scale, **tolerance("float32"))


def test_half_precision_gradients_are_summed_in_single_precision():
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
def test_empty_volumes_have_a_gradient_of_zero(size, channels):
    volume, kernel = jnp.zeros((*size, channels)), jnp.ones((3, 3, 3, channels, channels))
    found = jax.grad(lambda kernel: convolve_volume(volume, kernel).sum())(kernel)
    np.testing.assert_array_equal(found, np.zeros(kernel.shape))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("size", [(5, 3, 3), (1, 3, 3), (3, 5, 5)])
def test_kernel_of_another_size_is_refused(size):
    volume, kernel = jnp.ones((2, 4, 4, 2)), jnp.ones((*size, 2, 3))
    with pytest.raises(ValueError, match="must be 3x3x3"):
        convolve_volume(volume, kernel)
