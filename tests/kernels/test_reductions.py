"""Reductions over the leading axis against NumPy's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.kernels.reductions import max_leading, min_leading, softmax_leading, sum_leading

NUMPY = {
    sum_leading: lambda x: x.astype(np.float64).sum(0),
    min_leading: lambda x: x.min(0),
    max_leading: lambda x: x.max(0),
    softmax_leading: lambda x: np.exp(x) / np.exp(x.astype(np.float64)).sum(0),
}


@pytest.mark.parametrize("number", [1, 2, 3, 7, 8, 33])
@pytest.mark.parametrize("reduction", NUMPY)
def test_reductions_match_numpy(number, reduction, tolerance):
    stack = np.random.default_rng(number).normal(size=(number, 4, 5)).astype(np.float32)
    found = jax.jit(reduction)(jnp.asarray(stack))
    np.testing.assert_allclose(found, NUMPY[reduction](stack), **tolerance("float32"))


def test_softmax_of_large_numbers_is_finite():
    assert softmax_leading(jnp.array([1e4, 0.0, -1e4])).tolist() == [1.0, 0.0, 0.0]


@pytest.mark.parametrize("reduction", [sum_leading, min_leading, max_leading])
def test_nan_is_kept(reduction):
    stack = jnp.array([[0.0, 1.0], [jnp.nan, 2.0], [3.0, 4.0]])
    assert np.isnan(reduction(stack)).tolist() == [True, False]
