"""ProposalNet as a function: any arrangement of views, any range, any size."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.lightfield import view_offsets
from occjax.models import ProposalNet, preset, variable_shapes
from occjax.models.proposal import SearchConfig
from occjax.models.proposal.network import Selection, selection_confidence
from occjax.view_selection import select_view_indices
from tests.scenes import plane

CONFIG = preset("proposal_small")
NO_SELECTOR = dataclasses.replace(CONFIG, selector=None, residual=None)
OFFSETS = jnp.asarray(view_offsets(3, 3))
CANDIDATES = jnp.linspace(-3.0, 3.0, 13)


@functools.partial(jax.jit, static_argnames="config")
def apply(variables, views, offsets=None, candidates=None, config=CONFIG):
    return ProposalNet(config).apply(variables, views, offsets=offsets, candidates=candidates)


@pytest.fixture(scope="module")
def views(uniform):
    return uniform(3, 3, 16, 16)


@pytest.fixture(scope="module")
def output(variables, views):
    return apply(variables, views, OFFSETS, CANDIDATES)


def test_selection_is_among_the_proposals(output, tolerance):
    selection = output.selection
    assert selection.probabilities.shape == (1 + 8 + 1, 16, 16)  # refined, neighbours, second-best
    np.testing.assert_allclose(selection.probabilities.sum(0), 1, **tolerance("absolute"))
    assert (selection.disparity >= selection.proposed.min(0) - 1e-5).all()
    assert (selection.disparity <= selection.proposed.max(0) + 1e-5).all()
    np.testing.assert_array_equal(selection.proposed[0], output.refined)


def test_confidence_is_the_probability_of_the_close_proposals(variables, views):
    """Without the residual; with it, the confidence is that times a probability."""
    selector = {"params": {"selector": variables["params"]["selector"]}}
    config = dataclasses.replace(CONFIG, residual=None)
    output = apply(selector, views, OFFSETS, CANDIDATES, config=config)
    selection, window = output.selection, CONFIG.selector.window
    assert CONFIG.reach == 4 * np.abs(OFFSETS).max()  # the window is four times as wide here
    close = np.abs(selection.proposed - selection.disparity[None]) <= 4 * window
    probability = np.sum(np.where(close, selection.probabilities, 0), axis=0)
    assert (output.confidence <= probability + 1e-5).all()
    assert np.mean(np.abs(output.confidence - probability) < 1e-5) > 0.5
    assert (apply(variables, views, OFFSETS, CANDIDATES).confidence <= output.confidence).all()
    blank = apply(variables, jnp.full_like(views, 0.5), OFFSETS, CANDIDATES)
    assert blank.confidence.max() < 0.01


def test_confidence_is_at_most_1_where_the_sum_of_probabilities_is_rounded_up(uniform):
    probabilities = jax.nn.softmax(5.0 * uniform(10, 64, 64), axis=0)
    assert float(probabilities.sum(0).max()) > 1.0
    selection = Selection(jnp.zeros((64, 64)), jnp.zeros((10, 64, 64)), probabilities)
    assert float(selection_confidence(selection, jnp.ones((64, 64)), CONFIG).max()) == 1.0


def test_order_of_the_views_does_not_matter(variables, views, output, tolerance):
    order = np.array([8, 1, 2, 3, 4, 0, 6, 7, 5])  # the centre view stays
    shuffled = apply(
        variables,
        views.reshape(9, 16, 16)[order].reshape(views.shape),
        OFFSETS.reshape(9, 2)[order].reshape(OFFSETS.shape),
        CANDIDATES,
    )
    # Sums in another order differ in the last digits, which differences of close costs amplify.
    np.testing.assert_allclose(shuffled.disparity, output.disparity, **tolerance("amplified"))


def test_views_twice_as_far_apart_have_half_the_disparity(variables, views, output, tolerance):
    far = apply(variables, views, 2 * OFFSETS, CANDIDATES / 2)
    for name in ("disparity", "coarse", "refined", "standard_deviation"):
        near = getattr(output, name)
        np.testing.assert_allclose(
            getattr(far, name), near / 2, err_msg=name, **tolerance("absolute")
        )
    np.testing.assert_allclose(far.confidence, output.confidence, **tolerance("absolute"))


def test_coarse_disparity_is_within_the_candidates(variables, views):
    moved = apply(variables, views, OFFSETS, CANDIDATES + 7.0)
    assert moved.coarse.min() >= 4.0
    assert moved.coarse.max() <= 10.0


def test_default_candidates_and_offsets_are_those_of_the_reach(views, tolerance):
    grey, candidates, scale = ProposalNet(CONFIG).apply(
        {}, views, None, 2 * OFFSETS, multiple=2, method="normalise"
    )
    np.testing.assert_allclose(candidates, np.linspace(-4, 4, 33), **tolerance("absolute"))
    assert scale == 0.5
    assert jnp.abs(grey.offsets).max() == CONFIG.reach
    np.testing.assert_allclose(
        jnp.quantile(grey.centre, 0.99), CONFIG.exposure.white, **tolerance("relative")
    )


@pytest.mark.parametrize(
    "shape", [(1, 4, 3, 5), pytest.param((2, 2, 17, 19), marks=pytest.mark.slow)]
)
def test_any_grid_and_size_give_a_map_of_that_size(shape, uniform):
    found = apply({}, uniform(*shape), config=NO_SELECTOR)
    for name in ("disparity", "coarse", "refined", "confidence", "standard_deviation"):
        assert getattr(found, name).shape == shape[2:]
        assert np.isfinite(getattr(found, name)).all()
    assert found.selection is None


@pytest.mark.slow
def test_a_black_centre_view_gives_finite_maps(variables, views):
    output = jax.jit(ProposalNet(CONFIG).apply)(variables, views.at[1, 1].set(0.0))
    for maps in (output.disparity, output.confidence, output.standard_deviation):
        assert np.isfinite(maps).all()


def test_padding_changes_nothing_inside(variables):
    """On a slanted plane, before training: all steps up to the selection are correct."""
    config = dataclasses.replace(CONFIG, reach=1.0)  # of 3x3 views
    scene = plane(grid=(3, 3), size=(48, 32), disparity=0.4, slope=(0.01, -0.006))
    params = {
        name: module | {"score": jax.tree.map(jnp.zeros_like, module["score"])}
        for name, module in variables["params"].items()
    }
    params["selector"]["stay"] = jnp.float32(3.0)
    fresh = {"params": params}
    views, truth = jnp.asarray(scene.grey()), scene.ground_truth
    assert config.size_multiple == 16
    whole = apply(fresh, views, config=config)
    part = apply(fresh, views[..., :42, :], config=config).disparity
    assert part.shape == (42, 32)
    # The noise level depends on the whole view.
    assert np.quantile(np.abs(part - whole.disparity[:42])[8:32, 8:-8], 0.95) < 0.01
    for name, limit in (("coarse", 0.15), ("refined", 0.03), ("disparity", 0.03)):
        error = np.abs(getattr(whole, name) - truth)[6:-6, 6:-6]
        assert np.median(error) < limit, name


@pytest.mark.slow
@pytest.mark.parametrize("arrangement", ["17x17", "crosshair"])
def test_large_grids_and_crosshairs_find_the_disparity_of_a_wall(arrangement):
    """17 views are used of both: of the grid the two outermost in eight directions."""
    side, views = {"17x17": (17, "outer_star"), "crosshair": (9, "cross")}[arrangement]
    wall = plane(grid=(side, side), size=(48, 48), disparity=0.2, slope=(0.003, -0.002))
    offsets = view_offsets(side, side).reshape(-1, 2)
    selected = select_view_indices(offsets, views)
    assert len(selected) == 17
    found = apply(
        {},
        jnp.asarray(wall.grey().reshape(-1, 48, 48)[selected])[None],
        jnp.asarray(offsets[selected])[None],
        jnp.linspace(-0.5, 1.0, 25) * 8 / (side - 1),
        config=NO_SELECTOR,
    )
    error = np.abs(found.disparity - wall.ground_truth)[8:-8, 8:-8]
    assert np.quantile(error, 0.95) < 0.01


@pytest.mark.parametrize(
    ("shape", "candidates", "message"),
    [
        ((1, 1, 8, 8), 5, "at least 1x2"),
        ((3, 3, 8, 8), 2, "at least 3, not 2"),
        ((3, 3, 1, 8), 5, "at least 3x3 pixels, not 1x8"),
        ((3, 3, 8, 2), 5, "at least 3x3 pixels, not 8x2"),
    ],
)
def test_input_that_has_no_disparity_is_refused(shape, candidates, message):
    with pytest.raises(InputError, match=message):
        apply({}, jnp.zeros(shape), candidates=jnp.linspace(-1.0, 1.0, candidates))


def test_search_at_a_quarter_of_the_resolution_is_refused():
    with pytest.raises(ValueError, match="downsampling must be 1 or 2, not 4"):
        SearchConfig(downsampling=4)


def test_selector_with_a_search_at_full_resolution_is_refused():
    full = SearchConfig(downsampling=1)
    assert dataclasses.replace(NO_SELECTOR, search=full).size_multiple == 1
    with pytest.raises(ValueError, match=r"selector .* needs search.downsampling=2, not 1"):
        dataclasses.replace(CONFIG, search=full)


@pytest.mark.slow
def test_network_stays_within_its_memory():
    """By XLA's analysis; a process may peak at 1.5 GB with the rest of its memory."""
    config = preset("proposal")
    views, offsets = (
        jax.ShapeDtypeStruct((1, 17, *rest), jnp.float32) for rest in [(512, 512), (2,)]
    )
    run = jax.jit(lambda *arrays: apply.__wrapped__(*arrays, config=config).disparity)
    compiled = run.lower(variable_shapes(config), views, offsets).compile()
    assert compiled.memory_analysis().temp_size_in_bytes < 0.75e9
