"""The cascade over sectors: what it promises for any arrangement, range and size."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.views import chosen_views
from occjax.models import OccCasNet, StageConfig, preset
from occjax.models import choice as choice_module
from occjax.models import proposals as proposals_module
from occjax.models.config import Choice, Residual
from occjax.models.description import config_from_json, config_to_json
from occjax.models.proposals import Proposals
from occjax.models.stages import stage_output
from occjax.ops import edge_aware_mean, view_offsets
from tests.reference.variables import random_variables
from tests.scenes import plane

CONFIG = preset("light_small")


@pytest.fixture(scope="module")
def variables():
    return random_variables(CONFIG)


@functools.partial(jax.jit, static_argnames="config")
def apply(variables, views, offsets=None, candidates=None, config=CONFIG):
    return OccCasNet(config).apply(variables, views, offsets=offsets, candidates=candidates)


@functools.partial(jax.jit, static_argnames="config")
def propose(views, offsets, config=CONFIG):
    return OccCasNet(config).apply({}, views, offsets, method="propose")


@functools.partial(jax.jit, static_argnames="config")
def choose(variables, proposals, config=CONFIG):
    return OccCasNet(config).apply(variables, proposals, method="choose")


NEAR, TWICE = (dataclasses.replace(CONFIG, reach=reach) for reach in (1.0, 2.0))
"""Of a grid of 3x3 or 5x5 views no disparity is scaled."""


def _views(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).random(shape, np.float32))


@pytest.mark.parametrize("shape", [(3, 3, 33, 41), (1, 4, 16, 48), (5, 1, 17, 5), (2, 2, 3, 3)])
def test_any_grid_and_any_size_give_a_map_of_that_size(variables, shape):
    outputs = apply(variables, _views(*shape))
    assert len(outputs) == 3
    for output in outputs:
        assert output.disparity.shape == shape[2:]
        assert np.isfinite(output.disparity).all()
    assert outputs[0].probabilities.shape == (33, *shape[2:])
    assert outputs[1].probabilities.shape == (1 + 8 + 1, *shape[2:])  # itself, neighbours, second
    for output in outputs[:2]:
        np.testing.assert_allclose(output.probabilities.sum(0), 1, atol=1e-5)


def test_the_order_of_the_views_does_not_matter(variables):
    views, offsets = _views(3, 3, 16, 16), view_offsets(3, 3)
    order = np.array([8, 1, 2, 3, 4, 0, 6, 7, 5])  # the centre view stays
    expected = apply(variables, views, offsets)[-1].disparity
    shuffled = apply(
        variables,
        views.reshape(9, 16, 16)[order].reshape(views.shape),
        offsets.reshape(9, 2)[order].reshape(offsets.shape),
    )
    # Random weights give disparities of tens of pixels, sums in another order.
    np.testing.assert_allclose(shuffled[-1].disparity, expected, rtol=2e-5, atol=2e-5)


def test_views_twice_as_far_apart_have_half_the_disparity(variables):
    views, offsets = _views(3, 3, 16, 16), view_offsets(3, 3)
    candidates = jnp.linspace(-3.0, 3.0, 9)
    near = apply(variables, views, offsets, candidates)
    far = apply(variables, views, 2 * offsets, candidates / 2)
    for one, other in zip(near, far, strict=True):
        np.testing.assert_allclose(other.disparity, one.disparity / 2, atol=1e-5)
    np.testing.assert_allclose(far[0].candidates, candidates / 2, rtol=1e-6)
    default = apply(variables, views, 2 * offsets)[0].candidates
    np.testing.assert_allclose(default, np.linspace(-8, 8, 33), atol=1e-5)  # reach 4, views 2 apart


def test_candidates_of_any_number_can_be_given(variables):
    views = _views(3, 3, 16, 16)
    candidates = jnp.linspace(5.0, 9.0, 13)
    coarse = apply(variables, views, view_offsets(3, 3), candidates)[0]
    assert coarse.probabilities.shape[0] == 13
    assert coarse.disparity.min() >= 5.0
    assert coarse.disparity.max() <= 9.0


@pytest.fixture(scope="module")
def slanted():
    return plane(grid=(5, 5), size=(64, 32), disparity=0.4, slope=(0.01, -0.006))


@pytest.fixture(scope="module")
def fresh(slanted):
    """The weights before any training."""
    return jax.jit(OccCasNet(TWICE).init)(jax.random.key(0), jnp.asarray(slanted.grey()))


def test_a_size_that_needs_padding_gives_the_same_disparity_as_one_that_needs_none(slanted, fresh):
    views = jnp.asarray(slanted.grey())
    assert TWICE.multiple == 16
    whole = apply(fresh, views, config=TWICE)[-1].disparity
    part = apply(fresh, views[..., :50, :], config=TWICE)[-1].disparity
    assert part.shape == (50, 32)
    # Not quite: the noise of a view is estimated from all of it.
    assert np.quantile(np.abs(part - whole[:50])[8:40, 8:-8], 0.95) < 0.01


def test_the_choice_sees_a_hundred_pixels_across(variables):
    """A network with large untextured areas in mind; what is farther away must not matter."""
    assert len(preset("light").stages[1].aggregation.context) == 4  # as here
    proposals = propose(_views(1, 3, 16, 160), view_offsets(1, 3))
    changed = jax.tree.map(lambda field: field.at[..., 140:].multiply(0.5), proposals)
    before, after = (choose(variables, each).probabilities for each in (proposals, changed))
    difference = np.abs(before - after).max((0, 1))
    assert difference[89] > 1e-5
    assert difference[:20].max() == 0


@pytest.mark.parametrize("arrangement", ["17x17", "crosshair"])
def test_large_grids_and_crosshairs_find_the_disparity_of_a_wall(arrangement):
    """Both have 17 views that are looked at: of the grid the two outermost in eight directions."""
    side = {"17x17": 17, "crosshair": 9}[arrangement]
    wall = plane(grid=(side, side), size=(48, 48), disparity=0.2, slope=(0.003, -0.002))
    offsets = np.asarray(view_offsets(side, side)).reshape(-1, 2)
    chosen = chosen_views(offsets, "outer_star" if arrangement == "17x17" else "cross")
    assert len(chosen) == 17
    views = wall.grey().reshape(-1, 48, 48)[chosen]
    reach = np.abs(offsets).max() / CONFIG.reach
    found = propose(jnp.asarray(views)[None], jnp.asarray(offsets[chosen])[None])
    error = np.abs(found.disparity / reach - wall.ground_truth)[8:-8, 8:-8]
    assert np.quantile(error, 0.95) < 0.01


def test_the_choice_is_among_what_is_proposed(variables):
    """Proposals are given relative to the stage before, whatever steps lie between them."""
    coarse, refined, _ = apply(variables, _views(3, 3, 16, 16), view_offsets(3, 3))
    move = refined.disparity - coarse.disparity
    assert (move >= refined.candidates.min(0) - 1e-5).all()
    assert (move <= refined.candidates.max(0) + 1e-5).all()


def test_the_order_of_the_neighbours_does_not_matter(variables):
    """Of all proposals but the first, which is the disparity as it is, and the last."""
    proposals = propose(_views(3, 3, 64, 64), view_offsets(3, 3), config=NEAR)
    order = np.array([0, 8, 3, 1, 2, 7, 5, 4, 6, 9])
    search, choice = NEAR.stages
    places = tuple(choice.neighbours[k - 1] for k in order[1:-1])
    other = dataclasses.replace(
        NEAR, stages=(search, dataclasses.replace(choice, neighbours=places))
    )
    shuffled = proposals._replace(proposed=proposals.proposed[order], costs=proposals.costs[order])
    expected = choose(variables, proposals, config=NEAR)
    found = choose(variables, shuffled, config=other)
    np.testing.assert_allclose(found.probabilities, expected.probabilities[order], atol=1e-5)
    np.testing.assert_allclose(found.disparity, expected.disparity, atol=1e-5)
    elsewhere = choose(variables, shuffled, config=NEAR)
    assert np.abs(elsewhere.probabilities - expected.probabilities[order]).max() > 1e-3


def test_who_proposes_is_told_by_loops():
    generator = np.random.default_rng(0)
    places = CONFIG.stages[1].neighbours
    proposals = Proposals(
        *(
            jnp.asarray(generator.random(shape), jnp.float32)
            for shape in ((9, 11), (9, 11), (10, 9, 11), (10, 13, 9, 11), (2, 9, 11))
        )
    )
    sources = ((0, 0), *places, (0, 0))
    variations = choice_module._variations(proposals.centre, sources)
    told = jnp.concatenate(
        [
            choice_module._who_proposes(proposals, slice(k, k + 2), sources, variations)
            for k in range(0, 10, 2)
        ]
    )
    centre, _, proposed, costs, spread = map(np.asarray, proposals)

    def at(image, y, x):
        return image[np.clip(y, 0, 8), np.clip(x, 0, 10)]

    for k, (down, right) in enumerate(sources):
        for y, x in ((4, 5), (0, 10), (8, 2)):
            steps = max(abs(down), abs(right))
            way = [
                at(centre, y + np.sign(down) * step, x + np.sign(right) * step)
                for step in range(steps + 1)
            ]
            difference, variation = abs(way[-1] - way[0]), np.abs(np.diff(way)).sum()
            agreement = [1 / (1 + ((p - proposed[k, y, x]) / 0.05) ** 2) for p in proposed[:, y, x]]
            expected = [
                difference / (difference + 0.05),
                variation / (variation + 0.05),
                float(steps > 0),
                at(spread[0], y + down, x + right),
                at(spread[1], y + down, x + right),
                np.sqrt(at(costs[0, 9], y + down, x + right)),
                np.mean(agreement),
            ]
            np.testing.assert_allclose(told[k, :, y, x], expected, atol=1e-5)


def test_on_one_surface_all_neighbours_propose_the_same():
    scene = plane(grid=(3, 3), size=(64, 64), disparity=0.4, slope=(0.01, 0.005))
    proposals = propose(jnp.asarray(scene.grey()), view_offsets(3, 3), config=NEAR)
    np.testing.assert_array_equal(proposals.proposed[0], proposals.disparity)
    inner = np.s_[..., 16:-16, 16:-16]
    truth = scene.ground_truth
    assert np.median(np.abs(np.asarray(proposals.disparity) - truth)[inner]) < 0.02
    # Ten rows away the surface is 0.1 farther or nearer.
    assert np.median(np.abs(np.asarray(proposals.proposed[1:9]) - truth)[inner]) < 0.02
    away = np.abs(np.asarray(proposals.proposed[-1] - proposals.disparity))
    assert np.quantile(away, 0.05) > CONFIG.stages[1].second - 1 / 3
    # The views agree best at the true disparity: in all of the aperture and in its best half.
    for channel in (8, 9, 10, 11, 12):
        true, other = (np.median(proposals.costs[k, channel][inner]) for k in (0, -1))
        assert true < 0.5 * other


def test_neighbours_continue_their_surface_up_to_the_edge_and_beyond():
    """Two slanted planes that meet in a jump: each proposes itself on the other side too."""
    y, x = np.mgrid[:20, :48].astype(np.float32)
    left, right = 0.5 + 0.02 * y - 0.05 * x, -1.0 - 0.03 * y - 0.04 * x
    disparity = jnp.asarray(np.where(x < 24, left, right))
    right_of_it, left_of_it = proposals_module._continued(disparity, ((0, 3), (0, -3)))
    # Pixels at the jump see the jump on one side, their own slope on the other.
    inner = np.s_[:, 21:24]
    np.testing.assert_allclose(right_of_it[inner], right[inner], atol=1e-5)
    inner = np.s_[:, 24:27]
    np.testing.assert_allclose(left_of_it[inner], left[inner], atol=1e-5)
    lone = jnp.zeros((33, 33)).at[16, 16].set(1.0)  # higher than all around it: no slope
    of_it = proposals_module._continued(lone, ((0, 3),))[0]
    np.testing.assert_array_equal(of_it[:, 13], lone[:, 16])


def test_beside_the_border_a_surface_is_continued_too():
    y, x = np.mgrid[:24, :32].astype(np.float32)
    plane = 0.5 + 0.02 * y - 0.05 * x
    places = ((0, 4), (0, -4), (4, 0), (-10, 10))
    continued = np.asarray(proposals_module._continued(jnp.asarray(plane), places))
    for found, (down, right) in zip(continued, places, strict=True):
        # A neighbour beyond the border is the nearest pixel within.
        inner = np.s_[max(-down, 0) : 24 - max(down, 0), max(-right, 0) : 32 - max(right, 0)]
        np.testing.assert_allclose(found[inner], plane[inner], atol=1e-5)


def test_the_second_proposal_is_the_cheapest_far_from_the_first():
    candidates = jnp.linspace(-2.0, 2.0, 9)
    costs = jnp.abs(candidates - 0.5).at[1].set(0.1)[:, None, None]  # another dip at -1.5
    found = proposals_module.Search(jnp.full((1, 1), 0.5), costs, jax.nn.softmax(-costs, axis=0))
    second = proposals_module._second(found, candidates, 0.7)
    assert abs(float(second[0, 0]) + 1.5) <= 0.25  # to half the spacing


def test_aggregated_costs_are_read_between_candidates():
    candidates = jnp.linspace(-1.0, 1.0, 5)
    volume = jnp.asarray(np.random.default_rng(0).random((5, 3, 4)), jnp.float32)
    places = jnp.asarray(np.random.default_rng(1).uniform(-1.3, 1.3, (2, 6, 8)), jnp.float32)
    for place in places:
        found = proposals_module._of_blocks(volume, candidates, place)
        for row, column in np.ndindex(6, 8):
            of_block = volume[:, row // 2, column // 2]
            expected = np.interp(place[row, column], candidates, of_block)
            np.testing.assert_allclose(found[row, column], expected, atol=1e-5)


def test_means_along_a_slanted_surface_find_it_where_those_of_one_disparity_do_not():
    """Costs that noise hides in each pixel, of a plane that rises by five candidates."""
    candidates = jnp.linspace(-2.0, 2.0, 17)
    truth = jnp.asarray(np.linspace(-0.6, 0.6, 40)[None].repeat(40, 0), jnp.float32)
    noise = np.random.default_rng(0).normal(0.3, 0.2, (17, 40, 40))
    costs = jnp.minimum(jnp.abs(candidates[:, None, None] - truth[None]), 0.5) / 2 + noise
    guide = jnp.zeros((1, 40, 40))
    found = jax.jit(proposals_module._along_surfaces)(costs, candidates, truth + 0.2, guide)
    means = edge_aware_mean(costs, guide, radius=proposals_module.REACH)
    of_one = candidates[means.argmin(0)]
    error, other = (float(jnp.abs(each - truth)[4:-4, 4:-4].mean()) for each in (found, of_one))
    assert error < 0.03
    assert other > 3 * error


def test_before_training_it_is_semi_global_matching_with_planes(slanted, fresh):
    """What an untrained network answers on a slanted plane is already right."""
    coarse, refined, last = apply(fresh, jnp.asarray(slanted.grey()), config=TWICE)
    errors = [
        np.median(np.abs(output.disparity - slanted.ground_truth)[6:-6, 6:-6])
        for output in (coarse, refined, last)
    ]
    assert errors[0] < 0.1
    assert errors[1] < 0.02
    assert errors[2] < 0.02


def test_a_window_keeps_a_second_surface_out_of_the_mean():
    scores = jnp.log(jnp.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.4]) + 1e-9)[:, None, None]
    candidates = jnp.arange(6.0)
    whole = stage_output(scores, candidates).disparity
    near = stage_output(scores, candidates, window=2.0).disparity
    np.testing.assert_allclose(whole, 0.6 * 1 + 0.4 * 5, atol=1e-5)
    np.testing.assert_allclose(near, 1.0, atol=1e-5)


def test_a_window_also_goes_by_the_candidates_of_each_pixel():
    scores = jnp.log(jnp.array([[0.6, 0.1], [0.3, 0.2], [0.1, 0.7]]) + 1e-9)[:, None]
    candidates = jnp.array([[1.0, 0.0], [1.2, 2.0], [9.0, 2.1]])[:, None]
    near = stage_output(scores, candidates, window=0.25).disparity
    expected = [(0.6 * 1.0 + 0.3 * 1.2) / 0.9, (0.2 * 2.0 + 0.7 * 2.1) / 0.9]
    np.testing.assert_allclose(near[0], expected, atol=1e-5)


def test_the_network_learns_a_plane():
    """Fifty steps on one light field; that loss and gradients point the same way."""
    scene = plane(grid=(1, 3), size=(16, 16), disparity=0.3, slope=(0.0, 0.01))
    views, truth = jnp.asarray(scene.grey())[None], jnp.asarray(scene.ground_truth)[None]
    variables = random_variables(NEAR)

    def loss(params):
        outputs = jax.vmap(lambda one: OccCasNet(NEAR).apply({"params": params}, one))(views)
        errors = [jnp.abs(output.disparity - truth).mean() for output in outputs]
        return sum(errors), errors

    @jax.jit
    def step(params):
        (_, errors), gradient = jax.value_and_grad(loss, has_aux=True)(params)
        norm = jnp.sqrt(sum(jnp.sum(each**2) for each in jax.tree.leaves(gradient)))
        params = jax.tree.map(lambda value, slope: value - 0.15 * slope / norm, params, gradient)
        return params, errors

    params, first = step(variables["params"])
    for _ in range(50):
        params, last = step(params)
    for before, after in list(zip(first, last, strict=True))[1:]:  # the first has no weights
        assert float(after) < 0.5 * float(before)


def test_configurations_survive_json():
    for name in ("light", "occcasnet", "tiny"):
        assert config_from_json(config_to_json(preset(name))) == preset(name)
    with pytest.raises(ValueError, match="no network configuration"):
        config_from_json('{"stages": []}')


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"views": (9, 9)}, "either all volumes are of sectors"),
        ({"warp": "transposed"}, "no transposed warp"),
        ({"stages": CONFIG.stages[::-1]}, "no disparity before|one aggregated semi-globally"),
        ({"features": preset("tiny").features}, "compare DerivativeFeatures"),
        ({"stages": CONFIG.stages[:1] * 2}, "one aggregated semi-globally, then one for a Choice"),
    ],
)
def test_networks_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(CONFIG, **changes)


def test_a_volume_of_sectors_has_neither_attention_nor_the_published_aggregation():
    with pytest.raises(ValueError, match="aggregated by a Choice or not at all"):
        StageConfig((0.0, 1.0), volume="sectors", aggregation=Residual(), attention=False)
    with pytest.raises(ValueError, match="no attention"):
        dataclasses.replace(CONFIG.stages[0], attention=True)
    with pytest.raises(ValueError, match="are those of a Choice"):
        dataclasses.replace(CONFIG.stages[0], neighbours=((0, 1),))
    with pytest.raises(ValueError, match="it has no candidates"):
        StageConfig((0.0, 1.0), volume="sectors", aggregation=Choice(), attention=False)
