"""Reductions over the leading axis against NumPy's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.ops import planes


@pytest.mark.parametrize("number", [1, 2, 3, 7, 8, 33])
@pytest.mark.parametrize(
    ("reduced", "expected"),
    [
        (planes.sum_planes, lambda x: x.astype(np.float64).sum(0)),
        (planes.least_plane, lambda x: x.min(0)),
        (planes.greatest_plane, lambda x: x.max(0)),
        (planes.softmax_planes, lambda x: np.exp(x) / np.exp(x.astype(np.float64)).sum(0)),
    ],
)
def test_they_are_those_of_numpy(number, reduced, expected):
    stack = np.random.default_rng(number).normal(size=(number, 4, 5)).astype(np.float32)
    np.testing.assert_allclose(
        jax.jit(reduced)(jnp.asarray(stack)), expected(stack), rtol=1e-5, atol=1e-6
    )


def test_exponentials_of_large_numbers_stay_finite():
    assert planes.softmax_planes(jnp.array([1e4, 0.0, -1e4])).tolist() == [1.0, 0.0, 0.0]


def test_what_is_not_a_number_stays_so():
    stack = jnp.array([[0.0, 1.0], [jnp.nan, 2.0], [3.0, 4.0]])
    for reduced in (planes.sum_planes, planes.least_plane, planes.greatest_plane):
        assert np.isnan(reduced(stack)).tolist() == [True, False]


def test_no_reduction_is_left_to_the_compiler():
    lowered = jax.jit(planes.softmax_planes).lower(jnp.zeros((25, 8, 8))).as_text()
    assert "stablehlo.exponential" in lowered
    assert "stablehlo.reduce" not in lowered
