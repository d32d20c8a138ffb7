"""Support of proposals: against a NumPy loop, on slanted surfaces, and by colour."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.models import ProposalNet, preset
from occjax.models.proposal import SupportConfig
from occjax.models.proposal.filters import surface_slopes
from occjax.models.proposal.network import random_variables
from occjax.models.proposal.support import proposal_support

support_of = jax.jit(proposal_support, static_argnames="config")


def reference(proposed, disparity, slopes, certainty, appearance, config):
    """Sum the support of each pixel of the window, one by one."""
    height, width = disparity.shape
    down, right = slopes
    steps = range(-config.radius_px, config.radius_px + 1, config.step_px)
    result = np.zeros_like(proposed)
    for y, x in np.ndindex(height, width):
        for dy in steps:
            for dx in steps:
                at = y + dy, x + dx
                if not (0 <= at[0] < height and 0 <= at[1] < width):
                    continue
                difference = np.abs(appearance[:, *at] - appearance[:, y, x]).mean()
                weight = certainty[at] ** 2 * np.exp(-difference / config.appearance_scale)
                continued = disparity[at] - dy * down[at] - dx * right[at]
                distance = (proposed[:, y, x] - continued) / config.disparity_scale
                result[:, y, x] += weight / (1 + distance**2)
    return result / len(steps) ** 2


@pytest.mark.parametrize("channels", [1, 3])
def test_it_is_the_sum_over_the_window(channels, tolerance):
    generator = np.random.default_rng(0)
    proposed = generator.random((3, 13, 11), np.float32)
    disparity, certainty, *slopes = generator.random((4, 13, 11), np.float32)
    slopes = np.stack(slopes) / 10
    appearance = generator.random((channels, 13, 11), np.float32) / 20
    config = SupportConfig(radius_px=4, step_px=2)
    found = support_of(proposed, disparity, slopes, certainty, appearance, config=config)
    expected = reference(proposed, disparity, slopes, certainty, appearance, config)
    np.testing.assert_allclose(found, expected, **tolerance("float32"))


def test_a_slanted_surface_supports_its_own_disparity(tolerance):
    rows, columns = np.mgrid[:40, :40].astype(np.float32)
    plane = 0.05 * rows - 0.03 * columns
    proposed = np.stack([plane, plane + 0.2])
    ones = np.ones((40, 40), np.float32)
    config = SupportConfig(radius_px=12, step_px=4)
    slopes = surface_slopes(jnp.asarray(plane), 8)
    support = support_of(proposed, plane, slopes, ones, 0.5 * ones[None], config=config)
    middle = np.s_[12:28, 12:28]
    # All pixels of the window agree with the plane, and are off by two scales from the other one.
    np.testing.assert_allclose(support[0][middle], 1.0, **tolerance("float32"))
    np.testing.assert_allclose(support[1][middle], 1 / 5, **tolerance("float32"))


def test_pixels_that_are_not_certain_support_nothing():
    maps = np.ones((16, 16), np.float32)
    slopes = np.zeros((2, 16, 16), np.float32)
    support = support_of(maps[None], maps, slopes, 0 * maps, maps[None], config=SupportConfig())
    assert not np.any(support)


def test_colour_decides_where_grey_is_equal():
    # A near surface of the grey of the wall behind it; its disparity is fattened by six pixels.
    near = (np.arange(64) >= 32)[None] & np.ones((64, 1), bool)
    truth = np.where(near, 2.0, -1.0).astype(np.float32)
    fattened = np.tile(np.where(np.arange(64) >= 26, 2.0, -1.0).astype(np.float32), (64, 1))
    proposed = np.stack([fattened, np.full_like(fattened, -1.0), np.full_like(fattened, 2.0)])
    certainty = np.where(fattened == truth, 1.0, 0.2).astype(np.float32)
    colour = np.where(near, np.float32([[[0.6]], [[0.2]], [[0.3]]]), np.float32(0.326))
    grey = np.full((1, 64, 64), 0.326, np.float32)
    slopes = surface_slopes(jnp.asarray(fattened), 8)
    by_colour, by_grey = (
        np.asarray(support_of(proposed, fattened, slopes, certainty, each, config=SupportConfig()))
        for each in (colour, grey)
    )
    wrong = fattened != truth
    assert (by_colour[1] > 2 * by_colour[2])[wrong].all()
    assert not (by_grey[1] > 2 * by_grey[2])[wrong].all()


def test_the_network_without_colour_uses_grey():
    network = ProposalNet(preset("proposal_small", residual=None, planar=None))
    views = jax.random.uniform(jax.random.key(1), (3, 3, 32, 48))
    variables = random_variables(network.config, jax.random.key(0))
    run = jax.jit(network.apply)
    without = run(variables, views)
    same = run(variables, views, colour=views[1, 1][None])
    other = run(variables, views, colour=views[1, 1, :, ::-1][None])
    np.testing.assert_array_equal(without.disparity, same.disparity)
    assert np.any(without.disparity != other.disparity)


def test_the_step_must_divide_the_radius():
    with pytest.raises(ValueError, match="multiple of step_px, not 10 and 4"):
        SupportConfig(radius_px=10, step_px=4)


@pytest.mark.parametrize("name", ["appearance_scale", "disparity_scale", "floor"])
def test_scales_must_be_positive(name):
    with pytest.raises(ValueError, match="floor must be positive"):
        SupportConfig(**{name: 0.0})


@pytest.mark.usefixtures("unchecked")
def test_colour_of_another_size_is_refused():
    network = ProposalNet(preset("photometric"))
    with pytest.raises(InputError, match=r"colour must be \[c, 8, 12\], not \[8, 12, 3\]"):
        network.apply({}, jnp.zeros((3, 3, 8, 12)), colour=jnp.zeros((8, 12, 3)))
