"""How many multiplications the programs do that this library runs on a CPU.

    python -m experiments.operations > experiments/operations.md
    python -m experiments.operations --small                  (seconds, for the test)

Cost: half a minute; programs are traced, not run. Expected: inference by the published network and
a step of training it do half of the operations that it has as published, the light networks between
four and fifty thousand multiply-adds for each pixel and proposal. The result is committed beside
this file.

XLA's own analysis counts the body of a loop once. This goes through the program that JAX traces,
with every loop as often as it runs and the branch that a CPU takes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import prod
from typing import Annotated, Any

import jax
import jax.numpy as jnp
import tyro
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn

from experiments.command_line import main
from experiments.markdown import markdown_table
from experiments.networks import small_form
from occjax.data.samples import Sample
from occjax.inference.network import infer
from occjax.models import NetworkConfig, preset, variable_shapes
from occjax.models.config import of_kind
from occjax.models.work import count_flops
from occjax.training import init_state, train_step
from occjax.training.config import TrainConfig

LIGHT = ("light_small", "light", "light_large")
LOOKED_AT = 17
"""Views of a 9x9 grid that the light networks look at."""


def count_operations(function: Callable, *arguments: Any) -> int:
    """Operations of the matrix products and convolutions of a program, each multiply-add as two.

    Args:
        function: The program.
        *arguments: Arrays, or trees of them, or their shapes and types.

    Returns:
        Their number.

    Raises:
        ValueError: If there are any in a loop of unknown length.

    Example:
        >>> def seven_products(x):
        ...     return jax.lax.fori_loop(0, 7, lambda _, y: y @ x, x)
        >>> count_operations(seven_products, jnp.zeros((3, 3)))  # 7 products of 3x3 times 3
        378
    """
    return _of(jax.make_jaxpr(function)(*arguments).jaxpr)


def of_inference(config: NetworkConfig, size: int) -> int:
    """Operations of one estimate by :func:`occjax.infer`.

    Args:
        config: Of a grid of views, or of any arrangement, which then are 17.
        size: Height and width, in pixels.
    """
    views = jax.ShapeDtypeStruct((*(config.views or (1, LOOKED_AT)), size, size), jnp.float32)
    offsets = None if config.views else jax.ShapeDtypeStruct((1, LOOKED_AT, 2), jnp.float32)

    def disparity(variables, views, offsets):
        return infer(variables, views, config, offsets=offsets)[-1].disparity

    return count_operations(disparity, variable_shapes(config), views, offsets)


def of_training(network: NetworkConfig, size: int) -> int:
    """Operations of one step of training on one patch, with the paper's loss.

    Args:
        network: Of a grid of views.
        size: Height and width of the patch, in pixels.
    """
    grid = of_kind(network.views, tuple)
    shapes = ((*grid, size, size), (*grid, 2), (size, size), (*grid, size, size), (size, size))
    kinds = (jnp.float32, jnp.float32, jnp.float32, bool, bool)
    batch = Sample(*map(jax.ShapeDtypeStruct, ((1, *shape) for shape in shapes), kinds))
    config = TrainConfig(network)
    state = jax.eval_shape(partial(init_state, config), batch)
    return count_operations(partial(train_step, config=config), state, batch)


def of_published(networks: Mapping[str, NetworkConfig], size: int, patch: int) -> str:
    """What inference and training of networks of a grid do, beside what they have by formula.

    Args:
        networks: By the name that the table has.
        size: Height and width of the views of inference, in pixels.
        patch: Height and width of a patch of training.

    Returns:
        A Markdown table.
    """
    rows = []
    for name, network in networks.items():
        for what, side, counted, times in (
            ("inference", size, of_inference(network, size), 1),
            ("step of training", patch, of_training(network, patch), 3),
        ):
            formula = times * count_flops(network, (side, side))
            share = f"{counted / formula:.2f}"
            rows.append([f"`{name}`", what, str(side), _giga(formula), _giga(counted), share])
    return markdown_table(["network", "", "pixels", "by formula", "done", "ratio"], rows)


def of_light(networks: Mapping[str, NetworkConfig], size: int) -> str:
    """What networks of any arrangement of views do.

    Args:
        networks: By the name that the table has.
        size: Height and width of the views, in pixels.

    Returns:
        A Markdown table.
    """
    rows = []
    for name, network in networks.items():
        counted = of_inference(network, size)
        per_pixel = counted / 2 / size**2
        proposals = len(network.stages[1].neighbours) + 2
        costs = [f"{per_pixel:,.0f}", f"{per_pixel / proposals:,.0f}"]
        rows.append([f"`{name}`", str(size), _giga(counted), *costs])
    head = ["network", "pixels", "done", "multiply-adds per pixel", "per pixel and proposal"]
    return markdown_table(head, rows)


def run(
    small: Annotated[
        bool, tyro.conf.arg(help="Networks of 3x3 views and few channels, of few pixels.")
    ] = False,
) -> None:
    """Count and print two tables."""
    published = {name: preset(name) for name in ("occcasnet", "subfocal")}
    if small:
        published = {"occcasnet": small_form(published["occcasnet"])}
    size, patch = (32, 16) if small else (128, 32)
    print(of_published(published, size, patch))
    print(
        "\nOperations of convolutions and matrix products. The formula is that of the paper's "
        "tables, with normalisation and the zeros around an image; a step of training has three "
        "times that of inference.\n"
    )
    print(of_light({name: preset(name) for name in LIGHT[: 1 if small else None]}, 4 * size))
    print(f"\n{LOOKED_AT} views, as of a grid of 9x9; what is learned alone has such operations.")


def _of(jaxpr: Jaxpr) -> int:
    return sum(map(_of_equation, jaxpr.eqns))


def _of_equation(equation: JaxprEqn) -> int:
    parameters, inside = equation.params, [_of(jaxpr) for jaxpr in _inner(equation.params)]
    match equation.primitive.name:
        case "dot_general":
            ((contracted, _), _) = parameters["dimension_numbers"]
            shape = equation.invars[0].aval.shape
            return 2 * _results(equation) * prod(shape[axis] for axis in contracted)
        case "conv_general_dilated":
            kernel = equation.invars[1].aval.shape
            outputs = kernel[parameters["dimension_numbers"].rhs_spec[0]]
            return 2 * _results(equation) * prod(kernel) // outputs
        case "scan":
            return parameters["length"] * sum(inside)
        case "cond":
            names = parameters.get("branches_platforms") or ()
            return inside[_branch_of_a_cpu(names)] if names else max(inside)
        case "while" if any(inside):
            raise ValueError("nobody knows how often a while loop runs")
        case _:
            return sum(inside)


def _branch_of_a_cpu(platforms: tuple[tuple[str, ...] | None, ...]) -> int:
    """Of the branches for platforms, of which that of all others has None."""
    for_all = platforms.index(None)
    return next((i for i, names in enumerate(platforms) if names and "cpu" in names), for_all)


def _results(equation: JaxprEqn) -> int:
    return prod(equation.outvars[0].aval.shape)


def _inner(parameters: Mapping[str, Any]) -> Iterator[Jaxpr]:
    """Programs within an equation."""
    for value in parameters.values():
        for one in value if isinstance(value, tuple | list) else (value,):
            if isinstance(one, ClosedJaxpr):
                yield one.jaxpr
            elif isinstance(one, Jaxpr):
                yield one


def _giga(operations: float) -> str:
    return f"{operations / 1e9:,.3g} G" if operations < 1e12 else f"{operations / 1e12:.3g} T"


if __name__ == "__main__":
    main(run, __doc__)
