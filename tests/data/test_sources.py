"""Sources are functions of the step; mixtures of them keep their proportions."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data import sources
from occjax.data.config import AugmentationConfig
from occjax.data.procedural import SceneConfig
from occjax.data.samples import LightFieldSample
from occjax.data.sources import cached_source, mixture, procedural_source, sample_counts
from occjax.errors import InputError
from tests.data.scenes import cheap_scene


def numbered(name, batch_size=4, size=(2, 2)):
    """A source whose sample ``n`` has the disparity ``1000 name + n``; it counts its batches."""
    asked = []

    def source(step):
        asked.append(step)
        numbers = 1000.0 * name + step * batch_size + np.arange(batch_size, dtype=np.float32)
        disparity = jnp.asarray(np.tile(numbers[:, None, None], size), jnp.float32)
        views = jnp.zeros((batch_size, 1, 1, *size))
        seen = views == 0
        return LightFieldSample(
            views, jnp.zeros((batch_size, 1, 1, 2)), disparity, seen, seen[:, 0, 0]
        )

    source.asked = asked
    return source


def numbers(batch):
    return np.asarray(batch.disparity)[:, 0, 0].astype(int).tolist()


@pytest.mark.parametrize("weights", [[1.0], [3.0, 1.0], [0.61, 0.27, 0.12], [0.05, 0.05, 0.9]])
def test_shares_add_up_grow_and_stay_within_one_sample_of_their_weight(weights):
    before = [0] * len(weights)
    for total in range(400):
        found = sample_counts(weights, total)
        assert sum(found) == total
        assert all(now >= earlier for now, earlier in zip(found, before, strict=True))
        exact = total * np.array(weights) / sum(weights)
        assert np.abs(found - exact).max() <= 1.0 + 1e-9
        before = found


def test_a_mixture_takes_every_sample_of_its_sources_once_and_in_order():
    first, second = numbered(1), numbered(2)
    source = mixture({first: 0.7, second: 0.3})
    taken = [number for step in range(25) for number in numbers(source(step))]
    assert [number for number in taken if number < 2000] == list(range(1000, 1070))
    assert [number for number in taken if number >= 2000] == list(range(2000, 2030))


def test_every_batch_of_a_mixture_has_both_sources():
    source = mixture({numbered(1): 1.0, numbered(2): 1.0})
    for step in range(6):
        assert sum(number < 2000 for number in numbers(source(step))) == 2


def test_a_mixture_requests_no_batch_that_it_does_not_use():
    first, second = numbered(1), numbered(2)
    source = mixture({first: 3.0, second: 1.0})
    for step in range(8):
        source(step)
    assert sorted(first.asked) == list(range(6))
    assert sorted(second.asked) == list(range(2))


def test_the_batch_of_a_mixture_does_not_depend_on_earlier_requests():
    parts = {numbered(1): 0.6, numbered(2): 0.3, numbered(3): 0.1}
    in_order = mixture(parts)
    batches = [numbers(in_order(step)) for step in range(12)]
    for step in (11, 0, 7):
        assert numbers(mixture(parts)(step)) == batches[step]


def test_a_source_of_weight_zero_is_never_requested():
    idle = numbered(2)
    source = mixture({idle: 0.0, numbered(1): 1.0})
    assert numbers(source(3)) == [1012, 1013, 1014, 1015]
    assert idle.asked == []


@pytest.mark.parametrize("weights", [[], [0.0], [1.0, -1.0], [float("nan")]])
def test_mixtures_of_nothing_are_refused(weights):
    with pytest.raises(InputError, match="weights"):
        mixture({numbered(name): weight for name, weight in enumerate(weights)})


def test_sources_that_do_not_fit_together_are_refused():
    with pytest.raises(InputError, match="batches of 2 and 4"):
        mixture({numbered(1): 2.0, numbered(2, batch_size=2): 1.0})(1)
    with pytest.raises(InputError, match=r"views of \[1, 1, 2, 2\] and \[1, 1, 3, 2\]"):
        mixture({numbered(1): 1.0, numbered(2, size=(3, 2)): 1.0})(0)


def rows_of(source):
    """Return a source that also returns rows, and notes which."""
    requested = []

    def with_rows(step, rows=slice(None)):
        numbers = range(step * 4, step * 4 + 4)[rows]
        requested.extend(numbers)
        return jax.tree.map(lambda field: field[rows], source(step))

    with_rows.requested = requested
    return with_rows


@pytest.mark.parametrize("processes", [2, 4])
def test_the_rows_of_all_processes_are_the_batch_of_one(processes):
    """Each process requests little more than its share of the samples."""
    share, steps = 4 // processes, 30
    whole = mixture({numbered(1): 0.61, numbered(2): 0.27, numbered(3): 0.12})
    counts = []
    for process in range(processes):
        parts = [rows_of(numbered(name)) for name in (1, 2, 3)]
        mine = mixture(dict(zip(parts, (0.61, 0.27, 0.12), strict=True)))
        rows = slice(process * share, (process + 1) * share)
        for step in range(steps):
            assert numbers(mine(step, rows)) == numbers(whole(step))[rows]
        counts.append(sum(len(part.requested) for part in parts))
    assert max(counts) <= 2 * share * steps
    assert sum(counts) <= 1.7 * 4 * steps


CONFIG = SceneConfig(image_size=(8, 8), grid=(3, 3))


@pytest.fixture
def generator(monkeypatch):
    monkeypatch.setattr(sources, "generate", cheap_scene)


@pytest.mark.usefixtures("generator")
def test_procedural_light_fields_are_numbered_by_the_seed():
    batch = procedural_source(CONFIG, 3, seed=5)(2)
    for place in range(3):
        expected = cheap_scene(jax.random.fold_in(jax.random.key(5), 2 * 3 + place), CONFIG)
        found = jax.tree.map(lambda field, place=place: field[place], batch)
        jax.tree.map(np.testing.assert_array_equal, found, expected)


@pytest.mark.usefixtures("generator")
@pytest.mark.parametrize("make", [procedural_source, partial(cached_source, count=1)])
def test_light_fields_are_augmented_by_the_step_and_the_sample(make):
    options = {"batch_size": 2, "seed": 5, "augmentation": AugmentationConfig(crop=(6, 6))}
    first, second = make(CONFIG, **options), make(CONFIG, **options)
    first(0)
    assert first(1).views.shape == (2, 1, 9, 6, 6)
    jax.tree.map(np.testing.assert_array_equal, first(1), second(1))
    last = jax.tree.map(lambda field: field[1:], first(1))
    jax.tree.map(np.testing.assert_array_equal, second(1, slice(1, 2)), last)
    assert not np.array_equal(first(0).views, first(1).views)
    assert not np.array_equal(first(1).views[0], first(1).views[1])


@pytest.mark.usefixtures("generator")
def test_kept_light_fields_are_those_of_the_procedural_source(tolerance):
    rendered = [procedural_source(CONFIG, 2, seed=5)(step) for step in range(3)]
    disparity = np.concatenate([batch.disparity for batch in rendered])
    source, again = (cached_source(CONFIG, 5, 2, seed=5) for _ in range(2))
    seen = set()
    for step in (3, 0, *range(12)):
        batch = source(step)
        jax.tree.map(np.testing.assert_array_equal, batch, again(step))
        for place in range(2):
            (number,) = np.flatnonzero(
                (disparity == np.asarray(batch.disparity[place])).all((1, 2))
            )
            for name, found in batch._asdict().items():
                original = getattr(rendered[number // 2], name)[number % 2]
                limits = tolerance("8 bit") if name == "views" else {"rtol": 0}
                np.testing.assert_allclose(found[place], original, **limits)
            seen.add(int(number))
    assert seen == set(range(5))  # the sixth is rendered with the fifth, but not requested


def test_empty_sources_are_refused():
    with pytest.raises(InputError, match="batch_size is 0"):
        procedural_source(CONFIG, 0, seed=0)
    with pytest.raises(InputError, match="at least 1"):
        cached_source(CONFIG, 0, 2, seed=0)


@pytest.mark.usefixtures("generator")
def test_more_light_fields_than_the_memory_holds_are_refused():
    with pytest.raises(InputError, match=r"to keep take \d+ GB, more than the memory"):
        cached_source(CONFIG, 10**13, 2, seed=0)(0)
