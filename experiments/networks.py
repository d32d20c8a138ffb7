"""Networks of the paper's tables with their published numbers, and small variants of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.models import AggregationConfig, FeatureConfig, OccCasNetConfig, variable_shapes


class Published(NamedTuple):
    """A row of the paper's table 2 or 3.

    Attributes:
        name: Name as printed.
        parameters: Parameters in millions, as printed.
        tera_flops: Tera-operations for 9x9 views of 256x256 pixels, as printed.
        seconds: Seconds for such views on an RTX 3090; only in table 2.
        badpix: BadPix 0.07 in %, mean over the eight validation scenes of the HCI benchmark; only
            in table 3.
        mse: MSE x100, mean over the same scenes; only in table 3.
    """

    name: str
    parameters: str
    tera_flops: str
    seconds: float | None = None
    badpix: float | None = None
    mse: float | None = None


def _cas(name: str, parameters: str, tera_flops: str, badpix: float, mse: float) -> Published:
    return Published(name, parameters, tera_flops, badpix=badpix, mse=mse)


TABLE_2: Mapping[str, Published] = MappingProxyType(
    {
        "subfocal": Published("SubFocal-L", "5.06", "53.0", seconds=7.13),
        "occcasnet": Published("OccCasNet", "4.79", "13.2", seconds=1.13),
    }
)
"""Table 2, efficiency of the final networks, by preset."""

TABLE_3: Mapping[str, Published] = MappingProxyType(
    {
        "cas_1": _cas("Cas_1", "2.41", "3.11", 2.804, 1.164),
        "cas_2": _cas("Cas_2", "4.79", "5.87", 2.511, 1.187),
        "cas_3": _cas("Cas_3", "7.17", "8.63", 2.704, 1.195),
        "cas_4": _cas("Cas_4", "9.55", "11.4", 2.650, 1.079),
        "cas_2_share": _cas("Cas_2-share", "2.41", "5.87", 5.454, 1.088),
        "cas_2_occ": _cas("Cas_2-occ", "4.79", "5.87", 2.451, 1.065),
        "cas_2_occ_gt": _cas("Cas_2-occ-gt", "4.79", "5.87", 2.257, 0.792),
        "cas_2_interval_1_2": _cas("Cas_2", "4.79", "5.87", 2.759, 1.223),
        "cas_2_interval_1_4": _cas("Cas_2", "4.79", "5.87", 2.565, 1.077),
        "cas_2_interval_1_16": _cas("Cas_2", "4.79", "5.87", 2.553, 1.116),
        "cas_2_coarse_17": _cas("Cas_2", "4.79", "8.32", 2.068, 0.835),
        "cas_2_coarse_33": _cas("Cas_2", "4.79", "13.2", 1.828, 0.780),
        "occcasnet": _cas("Cas_2-occ", "4.79", "13.2", 1.733, 0.762),
    }
)
"""Table 3, the ablation, by preset."""

CAS_2_AGAIN = _cas("Cas_2", "4.79", "5.87", 2.651, 1.076)
"""Second row of table 3 for the network ``cas_2``, in the group of candidate numbers. Its distance
from the first row shows how much two trainings of the same network differ."""


def small_form(network: OccCasNetConfig) -> OccCasNetConfig:
    """Return the network with 3x3 views and few channels; stages and candidates are the same.

    Example:
        >>> from occjax.models import preset
        >>> small = small_form(preset("occcasnet"))
        >>> small.views, [len(stage.candidates) for stage in small.stages]
        ((3, 3), [33, 9])
    """
    return dataclasses.replace(
        network.with_stages(aggregation=AggregationConfig(4, 0)),
        views=(3, 3),
        features=FeatureConfig(
            widths=(4, 4), blocks=(1, 1), dilations=(1, 1), pooled=(2,), pooled_width=2, fused=4
        ),
        attention_width=4,
    )


SCORE_SCALE = 3e-4
"""Scale of the last layer's random kernel in :func:`random_light_field`."""


def random_light_field(
    config: OccCasNetConfig, height: int, width: int, *, score_scale: float = SCORE_SCALE
) -> tuple[dict, Float[Array, "v u h w"]]:
    """Return random weights and views.

    The scores are scaled to a few units, as in a trained network. Unscaled random scores are in the
    thousands: the softmax then selects a single candidate, and where two candidates tie, rounding
    decides between them.

    Args:
        config: The network.
        height: Height of the views, in pixels.
        width: Width of the views, in pixels.
        score_scale: Scale of the last layer's random kernel. The default suits the width of the
            published network; narrower networks need a larger one.

    Returns:
        Variables, and ``[v, u, h, w]`` float32 grey views in [0, 1].
    """
    generator = np.random.default_rng(0)

    def on_scores(path):
        return any(getattr(each, "key", None) == "score" for each in path)

    def draw(path, leaf):
        noise = generator.normal(size=leaf.shape)
        if path[-1].key == "kernel":
            noise *= np.sqrt(2 / np.prod(leaf.shape[:-1])) * (score_scale if on_scores(path) else 1)
        elif path[-1].key in ("scale", "var"):
            noise = 0.9 + 0.2 * np.abs(noise)
        else:
            noise *= 0.2
        return jnp.asarray(noise, leaf.dtype)

    variables = jax.tree_util.tree_map_with_path(draw, variable_shapes(config))
    shape = (*config.views, height, width)
    return variables, jnp.asarray(generator.uniform(size=shape), jnp.float32)


def candidate_numbers(network: OccCasNetConfig) -> str:
    """Return the number of candidates of each stage, as the paper prints them.

    Example:
        >>> from occjax.models import preset
        >>> candidate_numbers(preset("occcasnet"))
        '33, 9'
    """
    return ", ".join(str(len(stage.candidates)) for stage in network.stages)


def candidate_intervals(network: OccCasNetConfig) -> str:
    """Return the interval between candidates of each stage, as the paper prints them.

    Example:
        >>> from occjax.models import preset
        >>> candidate_intervals(preset("occcasnet"))
        '1/4, 1/8'
    """
    firsts = (stage.candidates[:2] for stage in network.stages)
    return ", ".join(str(Fraction(b - a).limit_denominator(1000)) for a, b in firsts)
