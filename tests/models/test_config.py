"""The paper's variants, by their published parameter counts, and what cannot be built."""

import jax
import jax.numpy as jnp
import pytest

from occjax.errors import InputError
from occjax.models import (
    PRESETS,
    FeatureConfig,
    NetworkConfig,
    OccCasNet,
    Residual,
    StageConfig,
    preset,
    sampled,
)
from occjax.models.config import Warp, _one_of


def count(config):
    shapes = jax.eval_shape(
        OccCasNet(config).init,
        jax.random.key(0),
        jax.ShapeDtypeStruct((*(config.views or (1, 3)), 16, 16), jnp.float32),
    )
    return sum(array.size for array in jax.tree.leaves(shapes))


def test_final_network_has_the_published_number_of_values():
    assert count(preset("occcasnet")) == 4_792_658


@pytest.mark.parametrize(
    ("name", "millions"),
    [("cas_1", 2.41), ("cas_2", 4.79), ("cas_3", 7.17), ("cas_4", 9.55), ("cas_2_share", 2.41)],
)
def test_ablation_rows_have_the_parameters_of_table_3(name, millions):
    assert round(count(preset(name)) / 1e6, 2) == millions


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


def test_occlusion_sources_are_those_of_the_paper():
    sources = {name: PRESETS[name].stages[1].occlusion for name in ("cas_2", "cas_2_occ")}
    assert sources == {"cas_2": "none", "cas_2_occ": "coarse"}
    assert preset("cas_2_occ_gt").stages[1].occlusion == "ground_truth"
    assert preset("occcasnet").stages[1].occlusion == "coarse"


def test_an_interval_that_does_not_divide_the_range_is_refused():
    with pytest.raises(ValueError, match="does not divide"):
        sampled(-1.0, 1.0, 0.3)


def test_an_unknown_preset_lists_the_known_ones():
    with pytest.raises(InputError, match="cas_2_occ"):
        preset("cas_5")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"stages": ()}, "at least one stage"),
        ({"stages": (StageConfig((0.0, 1.0), occlusion="coarse"),)}, "no disparity before"),
        ({"stages": (StageConfig((0.0, 1.0)),), "views": (3, 5)}, "attention=False"),
        ({"stages": (StageConfig((0.0, 1.0)),), "views": (4, 4)}, "attention=False"),
        (
            {
                "stages": (
                    StageConfig((0.0, 1.0)),
                    StageConfig((0.0, 1.0), aggregation=Residual(width=8)),
                ),
                "shared_aggregation": True,
            },
            "agree in width",
        ),
        (
            {
                "stages": (StageConfig((0.0, 1.0)), StageConfig((0.0, 1.0), attention=False)),
                "shared_aggregation": True,
            },
            "attention and volume",
        ),
    ],
)
def test_what_cannot_be_built_says_why(options, message):
    with pytest.raises(ValueError, match=message):
        NetworkConfig(**options)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        # As users see it: here the type checker would refuse the constructor before.
        (lambda: _one_of("warp", "transpose", Warp), "correct or transposed, not 'transpose'"),
        (lambda: StageConfig(()), "two or more, ascending"),
        (lambda: StageConfig((1.0, 0.0)), "two or more, ascending"),
        (lambda: StageConfig((0.0, 1.0), volume="statistics"), "no channels of single views"),
        (lambda: FeatureConfig(blocks=(1, 1)), "for 4, 2 and 4"),
        (lambda: sampled(-1.0, 1.0, 0.0), "does not divide"),
    ],
)
def test_a_misspelt_option_does_not_mean_another_network(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_without_attention_any_grid_can_be_configured():
    stage = StageConfig((-1.0, 0.0, 1.0), aggregation=Residual(4, 1), attention=False)
    config = NetworkConfig((stage,), views=(1, 4))
    views = jax.ShapeDtypeStruct((1, 4, 8, 8), jnp.float32)
    (output,), _ = jax.eval_shape(OccCasNet(config).init_with_output, jax.random.key(0), views)
    assert output.disparity.shape == (8, 8)
    assert output.attention is None
