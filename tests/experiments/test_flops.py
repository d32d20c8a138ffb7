"""FLOPs compared with counting loops, the paper's tables and XLA; parameters with Flax."""

from collections import defaultdict

import jax
import numpy as np
import pytest

from experiments.flops import count_flops, count_parameters, layers
from occjax.errors import InputError
from occjax.models import (
    AggregationConfig,
    FeatureConfig,
    OccCasNetConfig,
    StageConfig,
    preset,
    variable_shapes,
)
from tests.reference import network as reference
from tests.reference.network import Weights
from tests.reference.published_layout import published_shapes


def small_published_network() -> OccCasNetConfig:
    """Return a network of 3x3 views that the NumPy reference implements."""
    candidates = (0.0, 1.0, 2.0), (0.0, 1.0)
    stages = tuple(StageConfig(each, aggregation=AggregationConfig(width=6)) for each in candidates)
    return OccCasNetConfig(stages, views=(3, 3), attention_width=5)


def taps_inside(size: tuple[int, ...], taps: tuple[int, ...], dilation: int) -> int:
    """Count the taps inside the image over all pixels."""
    inside = 0
    for tap in np.ndindex(*taps):
        pixels = np.meshgrid(*map(np.arange, size), indexing="ij")
        at = [p + dilation * (t - n // 2) for p, t, n in zip(pixels, tap, taps, strict=True)]
        within = [(a >= 0) & (a < n) for a, n in zip(at, size, strict=True)]
        inside += np.logical_and.reduce(within).sum()
    return inside


def count_by_loops(image_size: tuple[int, int], monkeypatch) -> dict[str, np.ndarray]:
    """Count multiply-adds of the NumPy reference by part: all, and those inside the image."""
    counts = defaultdict(lambda: np.zeros(2, int))
    convolve = reference.convolve

    def counting(x, kernel, dilation=1):
        *taps, channels_in, channels = kernel.shape
        size = x.shape[-1 - len(taps) : -1]
        images = x.size // (np.prod(size) * channels_in)
        each = images * channels_in * channels
        part = "aggregation" if len(taps) == 3 else "features"
        everywhere, inside = np.prod(size) * np.prod(taps), taps_inside(size, taps, dilation)
        counts[part] += each * everywhere, each * inside
        return convolve(x, kernel, dilation)

    monkeypatch.setattr(reference, "convolve", counting)
    shapes = published_shapes(grid=3, attention=5, aggregation=6)
    weights = Weights.from_names({name: np.full(shape, 0.01) for name, shape in shapes.items()})
    views = np.random.default_rng(0).uniform(size=(3, 3, *image_size))
    first = reference.coarse_stage(weights, views, np.arange(3.0))
    reference.refined_stage(weights, views, first, np.arange(2.0), transposed=False)
    # Dense layers use each weight once; the reference does not call convolve for them.
    counts["attention"] += sum(kernel.size for kernel, bias in weights.conv3d if bias is not None)
    return counts


@pytest.mark.parametrize("image_size", [(20, 9), (3, 4)])
def test_multiply_adds_match_the_reference_network(image_size, monkeypatch):
    counted = count_by_loops(image_size, monkeypatch)
    for number, padding in enumerate((True, False)):
        found = defaultdict(int)
        for layer in layers(small_published_network(), image_size, padding=padding):
            found[layer.name.split("/")[0].split("_")[0]] += layer.multiply_adds
        assert found == {part: numbers[number] for part, numbers in counted.items()}


def test_elementwise_operations_match_a_count_by_hand():
    stage = StageConfig((0.0, 1.0, 2.0), aggregation=AggregationConfig(5, 1))
    features = FeatureConfig(2, (2, 3), (1, 1), (1, 1), (2,), 1, 4, 2)
    config = OccCasNetConfig((stage,), views=(1, 1), features=features, attention_width=7)
    counts = {layer.name: layer.others for layer in layers(config, (4, 6))}
    pixels, voxels = 24, 3 * 24
    assert counts == {
        "features/stem_0": 3 * 2 * pixels,
        "features/stem_1": 3 * 2 * pixels,
        "features/group_0_block_0/conv_0": 3 * 2 * pixels,  # normalised, rectified
        "features/group_0_block_0/conv_1": 3 * 2 * pixels,  # normalised, added
        "features/group_1_block_0/shortcut": 2 * 3 * pixels,  # normalised
        "features/group_1_block_0/conv_0": 3 * 3 * pixels,
        "features/group_1_block_0/conv_1": 3 * 3 * pixels,
        "features/pooled_2": 3 * 6,  # a quarter of the pixels
        "features/fused": 3 * 4 * pixels,
        "features/output": 0,
        "attention_0/hidden": 2 * 7,  # bias, ReLU
        "attention_0/octant": 1,  # bias
        "attention_0/product": 2 * voxels,
        "aggregation_0/conv_0": 3 * 5 * voxels,
        "aggregation_0/conv_1": 3 * 5 * voxels,
        "aggregation_0/pair_0_conv_0": 3 * 5 * voxels,
        "aggregation_0/pair_0_conv_1": 3 * 5 * voxels,
        "aggregation_0/conv_2": 3 * 5 * voxels,
        "aggregation_0/score": 0,
    }


@pytest.mark.parametrize(
    ("name", "tera"),
    [
        # Table 3 of the paper.
        ("cas_1", "3.11"),
        ("cas_2", "5.87"),
        ("cas_3", "8.63"),
        ("cas_4", "11.4"),
        ("cas_2_share", "5.87"),
        ("cas_2_occ", "5.87"),
        ("cas_2_occ_gt", "5.87"),
        ("cas_2_coarse_17", "8.32"),
        ("cas_2_coarse_33", "13.2"),
        # Table 2.
        ("occcasnet", "13.2"),
        ("subfocal", "53.0"),
    ],
)
def test_flops_match_the_paper_to_the_printed_digits(name, tera):
    assert f"{count_flops(preset(name)) / 1e12:#.3g}" == tera


@pytest.mark.parametrize("name", ["cas_1", "cas_2_share", "occcasnet", "subfocal", "tiny"])
def test_parameters_match_the_variables_of_flax(name):
    variables = jax.tree.leaves(variable_shapes(preset(name)))
    assert count_parameters(preset(name)) == sum(array.size for array in variables)


def test_layers_on_a_volume_of_statistics_match_the_variables_of_flax():
    config = preset("tiny").with_stages(attention=False, volume="statistics")
    variables = jax.tree.leaves(variable_shapes(config))
    assert count_parameters(config) == sum(array.size for array in variables)


def test_empty_image_is_rejected():
    with pytest.raises(InputError, match="not 0x4"):
        count_flops(preset("tiny"), (0, 4))
