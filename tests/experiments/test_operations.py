"""Work is counted, not timed: what the programs do is held to what it should be."""

import jax
import jax.numpy as jnp
import pytest

from experiments import operations
from experiments.networks import small_form
from experiments.operations import count_operations, of_inference, of_training
from occjax.models import OccCasNet, preset, variable_shapes
from occjax.models.work import count_flops

X = jnp.zeros((4, 6))


def test_products_and_convolutions_are_counted_as_by_hand():
    product = jnp.zeros((2, 4, 6)), jnp.zeros((2, 6, 5))
    assert count_operations(jnp.matmul, *product) == 2 * (2 * 4 * 5) * 6
    images, kernel = jnp.zeros((2, 7, 9, 4)), jnp.zeros((3, 3, 2, 8))

    def in_two_groups(images, kernel):
        return jax.lax.conv_general_dilated(
            images,
            kernel,
            (1, 1),
            "SAME",
            dimension_numbers=("NHWC", "HWIO", "NHWC"),
            feature_group_count=2,
        )

    # Each of 8 channels sees 3x3 pixels of 2.
    assert count_operations(in_two_groups, images, kernel) == 2 * (2 * 7 * 9 * 8) * (3 * 3 * 2)


def test_loops_count_as_often_as_they_run_and_functions_are_looked_into():
    def scanned(x):
        step = jax.checkpoint(lambda total, row: (total + x @ x.T @ row, None))
        return jax.lax.scan(step, x.sum(1), jnp.zeros((5, 4)))[0]

    once = 2 * (4 * 4 * 6 + 4 * 4)
    assert count_operations(jax.jit(scanned), X) == 5 * once


def test_a_loop_of_unknown_length_counts_only_if_there_is_nothing_in_it():
    def grow(x, by):
        return jax.lax.while_loop(lambda x: x.sum() < 1, by, x)

    assert count_operations(lambda x: grow(x, lambda x: x + 1), X) == 0
    with pytest.raises(ValueError, match="while"):
        count_operations(lambda x: grow(x, lambda x: x @ jnp.zeros((6, 6))), X)


def test_the_branch_of_a_cpu_counts_and_else_the_most_laborious():
    def twice(x):
        return x @ x.T @ x

    def by_platform(x):
        return jax.lax.platform_dependent(x, cpu=jnp.positive, default=twice)

    assert count_operations(by_platform, X) == 0
    by_value = count_operations(lambda x: jax.lax.cond(x.sum() > 0, twice, jnp.positive, x), X)
    assert by_value == count_operations(twice, X) == 2 * 2 * (4 * 4 * 6)


def test_the_network_as_it_is_written_has_the_operations_of_the_formula():
    """Which has 2 to 3 % more, for normalisation and what else is not a product."""
    config = preset("occcasnet")
    views = jax.ShapeDtypeStruct((9, 9, 64, 64), jnp.float32)
    counted = count_operations(OccCasNet(config).apply, variable_shapes(config), views)
    assert 0.95 * count_flops(config, (64, 64)) < counted < count_flops(config, (64, 64))


def test_inference_does_half_of_the_published_operations():
    config = preset("occcasnet")
    assert of_inference(config, 64) < 0.52 * count_flops(config, (64, 64))


def test_a_step_of_training_does_half_of_them_too():
    config = preset("occcasnet")
    assert of_training(config, 32) < 0.53 * 3 * count_flops(config, (32, 32))


@pytest.mark.parametrize(
    ("name", "per_pixel"), [("light_small", 40e3), ("light", 150e3), ("light_large", 530e3)]
)
def test_the_light_networks_do_no_more_for_a_pixel_than_is_documented(name, per_pixel):
    assert of_inference(preset(name), 128) < 2 * per_pixel * 128**2


def test_the_small_form_prints_both_tables(capsys):
    operations.run(small=True)
    lines = capsys.readouterr().out.splitlines()
    small = small_form(preset("occcasnet"))
    ratio = of_inference(small, 32) / count_flops(small, (32, 32))
    assert lines[2].endswith(f"| {ratio:.2f} |")
    assert lines[-3].startswith("| `light_small` | 128 | ")
