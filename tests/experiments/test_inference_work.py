"""The counts agree with the formula of the layer, and what cannot be counted is refused."""

import jax
import pytest

from experiments import inference_work
from experiments.inference_work import difference, random_light_field
from experiments.networks import small_form
from occjax.errors import InputError
from occjax.models import OccCasNet, preset
from occjax.models.work import layers


def test_the_layer_on_the_volume_is_the_one_that_the_formula_counts(capsys):
    (row,) = inference_work.run(networks=("occcasnet",), small=True)
    counted = {
        layer.name: layer
        for layer in layers(small_form(preset("occcasnet")), (256, 256), padding=False)
    }
    assert row.volume == pytest.approx(2 * counted["aggregation_0/conv_0"].multiply_adds, rel=0.05)
    # Per voxel 27 K F V U / D + 6 K U (V + 1) in place of 27 K F V U; on top the frame around the
    # volume, whose making is nearly as much where K is as small as here.
    config = small_form(preset("occcasnet"))
    grid, channels, candidates = config.views[0], config.features.channels, 33
    share = 1 / candidates + 6 * (grid + 1) / (27 * channels * grid)
    assert share < row.commuted / row.volume < 2 * share
    # A strip needs more rows of the views than it has.
    assert row.commuted / row.volume < row.strips_commuted / row.strips_volume < 2.2 * share
    # Two strips of 128 rows, and on each side a row for every layer, in place of 256 rows.
    rows = 128 + 2 * config.stages[0].aggregation.halo
    assert row.strips_volume == pytest.approx(row.volume * 2 * rows / 256, rel=0.05)
    printed = capsys.readouterr().out
    assert f"| {row.volume / row.commuted:.1f} |" in printed


def test_the_answer_is_the_same():
    config = small_form(preset("occcasnet"))
    variables, views = random_light_field(config, 21, 13, scores=10.0)
    written = jax.jit(OccCasNet(config).apply)(variables, views)[-1].disparity
    assert written.std() > 1.0  # there is something to agree on
    largest, median = difference(config, 21, 13, scores=10.0)
    assert 0 < largest < 1e-4
    assert median < 1e-5


def test_networks_without_a_volume_are_refused():
    with pytest.raises(InputError, match="light has no volume"):
        inference_work.run(networks=("light",))
    with pytest.raises(InputError, match="--size must be 1 or more"):
        inference_work.run(size=0)
