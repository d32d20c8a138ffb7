"""How much less work inference does in the first layer than the network as it is written.

    python -m experiments.inference_work > experiments/inference_work.md
    python -m experiments.inference_work --size 512 --networks occcasnet
    python -m experiments.inference_work --small                      (seconds, for the test)

Cost: half a minute, less than 2 GB; operations are counted of lowered programs that are never run,
and one small light field is estimated twice. Expected: with 33 candidates about a tenth of the
operations where the image is computed at once, a ninth in strips, which have more border; with
nine candidates, over which the convolution of the views is divided, a fifth; the same disparity.
The result is committed beside this file.

The first layer is the first convolution of the first stage, on the coarse volume.
:mod:`occjax.ops.convolved_volume` says how inference computes it, except on a CPU, where the layer
on the volume is quicker with fewer multiplications: :mod:`occjax.ops.minimal_filtering`.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Array, Float

from experiments.command_line import main
from experiments.efficiency_table import tera
from experiments.networks import small_form
from occjax.errors import InputError
from occjax.inference.network import infer, rows_of_strip
from occjax.models import NetworkConfig, OccCasNet, preset, variable_shapes
from occjax.models.config import FeatureConfig, Residual, of_kind
from occjax.models.volume_convolution import convolve_volume
from occjax.models.work import count_flops
from occjax.ops import coarse_volume, convolved_coarse_volume

SCORES = 3e-4
"""Factor on the random kernel of the last layer."""


class Row(NamedTuple):
    """Operations in one network.

    Attributes:
        name: Of the preset.
        network: All of it, as written, by formula.
        volume: Its first layer, on the volume.
        commuted: The same, views convolved before they are shifted.
        strips_volume: The first layer in strips, on the volume.
        strips_commuted: As inference computes it, in strips.
    """

    name: str
    network: float
    volume: float
    commuted: float
    strips_volume: float
    strips_commuted: float


def first_layer(config: NetworkConfig, size: int, rows: int) -> tuple[float, float]:
    """Operations of the first layer of some rows, as XLA counts them.

    Args:
        config: A network of a grid of views.
        size: Height and width of the views, in pixels.
        rows: Rows of the centre view that are computed.

    Returns:
        Of the volume and its convolution, and of the convolved views.

    Raises:
        RuntimeError: If the program has a loop, whose body would count once only, or a branch.
    """
    stage = config.stages[0]
    v, u = of_kind(config.views, tuple)
    channels = of_kind(config.features, FeatureConfig).channels
    shapes = (
        (v, u, size, size, channels),
        (3, 3, 3, v * u * channels, of_kind(stage.aggregation, Residual).width),
    )
    candidates = jnp.asarray(stage.candidates, jnp.float32)
    span = stage.candidates[-1] - stage.candidates[0]

    def on_volume(features, kernel):
        return convolve_volume(coarse_volume(features, candidates, rows=(0, rows)), kernel)

    def counted(function) -> float:
        arguments = (jax.ShapeDtypeStruct(shape, jnp.float32) for shape in shapes)
        lowered = jax.jit(function).lower(*arguments)
        text = lowered.as_text()
        if "stablehlo.while" in text or "stablehlo.case" in text:
            raise RuntimeError("XLA counts the body of a loop once and branches that are not taken")
        return of_kind(lowered.cost_analysis(), dict)["flops"]

    def commuted(features, kernel):
        return convolved_coarse_volume(features, candidates, kernel, rows=(0, rows), span=span)

    return counted(on_volume), counted(commuted)


def count(name: str, config: NetworkConfig, size: int) -> Row:
    """Operations of a network on views of a size."""
    halo = of_kind(config.stages[0].aggregation, Residual).halo
    rows = rows_of_strip(size, size, halo)
    whole = first_layer(config, size, size)
    strips = whole
    if size > rows + 2 * halo:
        volume, commuted = first_layer(config, size, rows + 2 * halo)
        number = -(-size // rows)
        strips = number * volume, number * commuted
    return Row(name, count_flops(config, (size, size), padding=False), *whole, *strips)


def random_light_field(
    config: NetworkConfig, height: int, width: int, *, scores: float = SCORES
) -> tuple[dict, Float[Array, "v u h w"]]:
    """Random weights and views.

    The scores are scaled to the few units that a trained network has: random ones are thousands,
    and a pixel at which two candidates tie jumps from one to the other with the last bit, in any
    order of the sums.

    Args:
        config: A network of a grid of views.
        height: Of the views, in pixels.
        width: Likewise.
        scores: Factor on the random kernel of the last layer; by default for networks as wide as
            the published one, narrow ones need more.
    """
    generator = np.random.default_rng(0)

    def on_scores(path):
        return any(getattr(each, "key", None) == "score" for each in path)

    def draw(path, leaf):
        noise = generator.normal(size=leaf.shape)
        if path[-1].key == "kernel":
            noise *= np.sqrt(2 / np.prod(leaf.shape[:-1])) * (scores if on_scores(path) else 1)
        elif path[-1].key in ("scale", "var"):
            noise = 0.9 + 0.2 * np.abs(noise)
        else:
            noise *= 0.2
        return jnp.asarray(noise, leaf.dtype)

    variables = jax.tree_util.tree_map_with_path(draw, variable_shapes(config))
    shape = (*of_kind(config.views, tuple), height, width)
    return variables, jnp.asarray(generator.uniform(size=shape), jnp.float32)


def difference(
    config: NetworkConfig, height: int = 48, width: int = 40, *, scores: float = SCORES
) -> tuple[float, float]:
    """Largest and median difference of disparity between inference and the network as written.

    On a random light field, in strips of eight rows.
    """
    variables, views = random_light_field(config, height, width, scores=scores)
    written = jax.jit(OccCasNet(config).apply)(variables, views)
    inferred = jax.jit(partial(infer, config=config, strip_rows=8))(variables, views)
    apart = np.abs(
        np.asarray(of_kind(written, tuple)[-1].disparity) - np.asarray(inferred[-1].disparity)
    )
    return float(apart.max()), float(np.median(apart))


def table(rows: list[Row]) -> str:
    """Operations as a Markdown table."""
    head = (
        *("preset", "whole network", "first layer", "views convolved first", "ratio"),
        *("in strips", "views convolved first", "ratio", "all of the network then"),
    )
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for row in rows:
        cells = (
            f"`{row.name}`",
            *(tera(each) for each in (row.network, row.volume, row.commuted)),
            f"{row.volume / row.commuted:.1f}",
            *(tera(each) for each in (row.strips_volume, row.strips_commuted)),
            f"{row.strips_volume / row.strips_commuted:.1f}",
            f"{100 * (1 - (row.volume - row.commuted) / row.network):.0f} %",
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def run(
    size: Annotated[int, tyro.conf.arg(help="Height and width of the views, pixels.")] = 256,
    networks: Annotated[tuple[str, ...], tyro.conf.arg(help="Presets of a grid of views.")] = (
        *("cas_1", "cas_2_coarse_17", "occcasnet", "subfocal"),
    ),
    small: Annotated[
        bool, tyro.conf.arg(help="Networks of 3x3 views and few channels at 256 pixels.")
    ] = False,
) -> list[Row]:
    """Count, compare the answers, print the table and return its rows."""
    size = 256 if small else size
    if size < 1:
        raise InputError(f"--size must be 1 or more, not {size}")
    configs = {name: preset(name) for name in networks}
    for name, config in configs.items():
        if config.views is None:
            raise InputError(f"--networks: {name} has no volume of a grid of views")
    compared = preset("occcasnet")
    if small:
        configs = {name: small_form(config) for name, config in configs.items()}
        compared = small_form(compared)
    rows = [count(name, config, size) for name, config in configs.items()]
    print(table(rows))
    largest, median = difference(compared)
    print(
        f"\nViews of {size}x{size} pixels. Operations as XLA counts them, a multiply-add as two, "
        f"of the whole network by formula; strips as inference makes them, with their "
        f"halo. Disparity of `occcasnet` with random weights on random views of 48x40 pixels, in "
        f"strips of eight rows, differs by {largest:.1e} at most and {median:.1e} in the median."
    )
    return rows


if __name__ == "__main__":
    main(run, __doc__)
