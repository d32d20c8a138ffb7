"""Layers of OccCasNet against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np

from occjax.models import preset
from occjax.models.occcasnet.aggregation import ViewAttention
from occjax.models.occcasnet.features import FeatureNetwork, upsample


def test_upsampling_keeps_the_corners_and_is_linear_between_them(tolerance):
    corners = jnp.array([[0.0, 3.0], [10.0, 13.0]])[None, :, :, None]
    rows, columns = np.mgrid[0:6, 0:4]
    expected = rows / 5 * 10 + columns / 3 * 3
    np.testing.assert_allclose(
        upsample(corners, 6, 4)[0, ..., 0], expected, **tolerance("relative")
    )
    pixel = upsample(jnp.full((1, 1, 1, 1), 7.0), 3, 5)
    np.testing.assert_array_equal(pixel, np.full((1, 3, 5, 1), 7.0))


def test_attention_is_symmetric_under_all_flips_and_the_transpose(uniform):
    attention = ViewAttention(views=5, hidden=4)
    weights, _ = attention.init_with_output(jax.random.key(1), uniform(5 * 5 * 2) - 0.5)
    for symmetric in (weights.T, weights[::-1], weights[:, ::-1]):
        np.testing.assert_array_equal(weights, symmetric)
    assert len(np.unique(np.asarray(weights))) == 6  # one octant of a 5x5 grid


def test_features_of_a_view_do_not_depend_on_the_other_views(tiny_variables, uniform):
    network = FeatureNetwork(preset("tiny").features)
    variables = {name: collection["features"] for name, collection in tiny_variables.items()}
    images = uniform(3, 9, 10, 1)
    features = jax.jit(lambda images: network.apply(variables, images, train=False))
    together = features(images)
    changed = features(images.at[0].set(0.0).at[2].set(1.0))
    np.testing.assert_array_equal(together[1], changed[1])
    assert np.abs(together[0] - changed[0]).max() > 0.01
