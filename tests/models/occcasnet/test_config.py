"""The paper's variants, by their published tables, and configurations that cannot be built."""

import math

import jax
import pytest

from occjax.errors import InputError
from occjax.models import (
    AggregationConfig,
    FeatureConfig,
    OccCasNetConfig,
    StageConfig,
    evenly_spaced,
    preset,
    variable_shapes,
)

STAGE = StageConfig((0.0, 1.0))


def number_of_values(name):
    leaves = jax.tree.leaves(variable_shapes(preset(name)))
    return sum(math.prod(leaf.shape) for leaf in leaves)


def test_final_network_has_the_published_number_of_values():
    assert number_of_values("occcasnet") == 4_792_658


@pytest.mark.parametrize(
    ("name", "millions"),
    [("cas_1", 2.41), ("cas_2", 4.79), ("cas_3", 7.17), ("cas_4", 9.55), ("cas_2_share", 2.41)],
)
def test_variants_have_the_parameters_of_table_3(name, millions):
    assert round(number_of_values(name) / 1e6, 2) == millions


@pytest.mark.parametrize(
    ("name", "numbers", "intervals"),
    [
        # Table 3, columns "Disp. Num." and "Disp. Interv."
        ("cas_1", [9], [1]),
        ("cas_2", [9, 9], [1, 1 / 8]),
        ("cas_3", [9, 9, 9], [1, 1 / 8, 1 / 16]),
        ("cas_4", [9, 9, 9, 9], [1, 1 / 8, 1 / 16, 1 / 32]),
        ("cas_2_interval_1_2", [9, 9], [1, 1 / 2]),
        ("cas_2_interval_1_4", [9, 9], [1, 1 / 4]),
        ("cas_2_interval_1_16", [9, 9], [1, 1 / 16]),
        ("cas_2_coarse_17", [17, 9], [1 / 2, 1 / 8]),
        ("cas_2_coarse_33", [33, 9], [1 / 4, 1 / 8]),
        ("occcasnet", [33, 9], [1 / 4, 1 / 8]),
        ("subfocal", [81], [1 / 10]),
    ],
)
def test_candidates_are_those_of_the_paper(name, numbers, intervals):
    stages = preset(name).stages
    assert [len(stage.candidates) for stage in stages] == numbers
    for stage, interval in zip(stages, intervals, strict=True):
        steps = [b - a for a, b in zip(stage.candidates, stage.candidates[1:], strict=False)]
        assert steps == pytest.approx([interval] * len(steps))
        assert stage.candidates[0] == pytest.approx(-stage.candidates[-1])
    assert stages[0].candidates[-1] == pytest.approx(4)


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("cas_2", "none"),
        ("cas_2_occ", "coarse"),
        ("cas_2_occ_gt", "ground_truth"),
        ("occcasnet", "coarse"),
    ],
)
def test_occlusion_sources_are_those_of_the_paper(name, source):
    assert preset(name).stages[1].occlusion == source


def test_unknown_preset_lists_the_known_ones():
    with pytest.raises(InputError, match="did you mean"):
        preset("cas_5")


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: OccCasNetConfig(()), "at least one stage"),
        (
            lambda: OccCasNetConfig((StageConfig((0.0, 1.0), occlusion="coarse"),)),
            "the first stage cannot",
        ),
        (lambda: OccCasNetConfig((STAGE,), views=(3, 5)), "attention=False"),
        (lambda: OccCasNetConfig((STAGE,), views=(4, 4)), "attention=False"),
        (
            lambda: OccCasNetConfig(
                (STAGE, StageConfig((0.0, 1.0), aggregation=AggregationConfig(width=8))),
                shared_aggregation=True,
            ),
            "agree in width",
        ),
        (
            lambda: OccCasNetConfig(
                (STAGE, StageConfig((0.0, 1.0), attention=False)), shared_aggregation=True
            ),
            "attention and volume",
        ),
        (lambda: StageConfig(()), "two or more, ascending"),
        (lambda: StageConfig((1.0, 0.0)), "two or more, ascending"),
        (lambda: StageConfig((0.0, 1.0), volume="statistics"), "no channels of single views"),
        (lambda: FeatureConfig(blocks=(1, 1)), "not 4, 2 and 4"),
        (lambda: evenly_spaced(-1.0, 1.0, 0.0), "must divide the range"),
        (lambda: evenly_spaced(-1.0, 1.0, 0.3), "must divide the range"),
    ],
)
def test_configurations_that_cannot_be_built_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.usefixtures("unchecked")
def test_misspelt_option_lists_the_choices():
    with pytest.raises(ValueError, match="warp is 'transpose'; did you mean 'transposed'"):
        OccCasNetConfig((STAGE,), warp="transpose")
