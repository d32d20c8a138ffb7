"""Comparison of forward mode, reverse mode and finite differences of one function."""

from collections.abc import Callable

import jax
import numpy as np

from tests.conftest import TOLERANCE

STEP = 1e-6
"""Step of the central differences, in double precision: too small to cross a kink by accident."""


def assert_derivatives(function: Callable, *arguments) -> None:
    """Check that the three derivatives agree in a random direction of each argument in turn.

    Args:
        function: Function of float64 arrays that returns one array; it must not sample at whole
            positions.
        *arguments: Point at which to differentiate.
    """
    generator = np.random.default_rng(7)
    arguments = tuple(np.asarray(argument, np.float64) for argument in arguments)
    cotangent = generator.normal(size=jax.eval_shape(function, *arguments).shape)

    @jax.jit
    def evaluate(primals, tangents):
        value, forward = jax.jvp(function, primals, tangents)
        _, reverse = jax.vjp(function, *primals)
        return value, forward, reverse(jax.numpy.asarray(cotangent))

    for index, argument in enumerate(arguments):
        tangents = [np.zeros_like(each) for each in arguments]
        tangents[index] = direction = generator.normal(size=argument.shape)
        after, before = (
            [a + step * t for a, t in zip(arguments, tangents, strict=True)]
            for step in (STEP, -STEP)
        )
        values = [evaluate(tuple(each), tuple(tangents))[0] for each in (after, before)]
        difference = np.subtract(*values) / (2.0 * STEP)
        _, forward, reverse = evaluate(arguments, tuple(tangents))
        assert np.abs(difference).max() > 1e-3, f"the result does not depend on argument {index}"
        np.testing.assert_allclose(forward, difference, **TOLERANCE["finite difference"])
        product = np.vdot(cotangent, forward)
        np.testing.assert_allclose(
            np.vdot(reverse[index], direction), product, **TOLERANCE["float64"]
        )
