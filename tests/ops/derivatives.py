"""Forward mode, reverse mode and finite differences of one function, compared."""

from collections.abc import Callable

import jax
import numpy as np

STEP = 1e-6
"""Of the central differences, in double precision: too small to cross a kink by accident."""
TOLERANCE = {"rtol": 1e-6, "atol": 1e-7}
"""Rounding of values near one, divided by the step, with a margin."""


def assert_derivatives(function: Callable, *arguments) -> None:
    """The three derivatives agree in a random direction of each argument in turn.

    Args:
        function: Of float64 arrays, returning one array; positions it samples at are not whole.
        *arguments: Where to differentiate.
    """
    generator = np.random.default_rng(7)
    arguments = tuple(np.asarray(argument, np.float64) for argument in arguments)
    shape = jax.eval_shape(function, *arguments).shape
    cotangent = generator.normal(size=shape)

    @jax.jit
    def evaluate(primals, tangents):
        value, forward = jax.jvp(function, primals, tangents)
        _, reverse = jax.vjp(function, *primals)
        return value, forward, reverse(jax.numpy.asarray(cotangent))

    for index, argument in enumerate(arguments):
        direction = generator.normal(size=argument.shape)
        tangents = [np.zeros_like(each) for each in arguments]
        tangents[index] = direction

        def along(step, tangents=tuple(tangents)):
            moved = tuple(a + step * t for a, t in zip(arguments, tangents, strict=True))
            return [np.asarray(each) for each in evaluate(moved, tangents)[:2]]

        difference = (along(STEP)[0] - along(-STEP)[0]) / (2.0 * STEP)
        derivative = along(0.0)[1]
        assert np.abs(difference).max() > 1e-3, f"the result does not depend on argument {index}"
        np.testing.assert_allclose(derivative, difference, **TOLERANCE)
        gradient = evaluate(arguments, tuple(tangents))[2][index]
        np.testing.assert_allclose(
            np.vdot(gradient, direction), np.vdot(cotangent, derivative), rtol=1e-9
        )
