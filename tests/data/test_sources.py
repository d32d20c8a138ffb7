"""Sources are functions of the step; mixtures of them keep their proportions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data import sources
from occjax.data.augmentation import AugmentationConfig
from occjax.data.samples import Sample
from occjax.data.scene_config import SceneConfig
from occjax.data.sources import (
    kept_source,
    mixture,
    procedural_source,
    random_views,
    shares,
)
from occjax.errors import InputError
from tests.data.scenes import grid


def numbered(name, batch_size=4, size=(2, 2)):
    """A source whose sample ``n`` has the disparity ``1000 name + n``; it counts its batches."""
    asked = []

    def source(step):
        asked.append(step)
        numbers = 1000.0 * name + step * batch_size + np.arange(batch_size, dtype=np.float32)
        disparity = jnp.asarray(np.tile(numbers[:, None, None], size), jnp.float32)
        views = jnp.zeros((batch_size, 1, 1, *size))
        seen = views == 0
        return Sample(views, jnp.zeros((batch_size, 1, 1, 2)), disparity, seen, seen[:, 0, 0])

    source.asked = asked
    return source


def numbers(batch):
    return np.asarray(batch.disparity)[:, 0, 0].astype(int).tolist()


@pytest.mark.parametrize("weights", [[1.0], [3.0, 1.0], [0.61, 0.27, 0.12], [0.05, 0.05, 0.9]])
def test_shares_add_up_grow_and_stay_within_one_sample_of_their_weight(weights):
    before = [0] * len(weights)
    for total in range(400):
        found = shares(weights, total)
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


def test_a_mixture_makes_nothing_in_vain():
    first, second = numbered(1), numbered(2)
    source = mixture({first: 3.0, second: 1.0})
    for step in range(8):
        source(step)
    assert sorted(first.asked) == list(range(6))
    assert sorted(second.asked) == list(range(2))


def test_a_mixture_gives_the_same_batch_whatever_was_asked_before():
    parts = {numbered(1): 0.6, numbered(2): 0.3, numbered(3): 0.1}
    in_order = mixture(parts)
    batches = [numbers(in_order(step)) for step in range(12)]
    for step in (11, 0, 7):
        assert numbers(mixture(parts)(step)) == batches[step]


def test_a_source_of_no_weight_is_never_asked():
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


def cheap_scene(key, config, photographs=None):
    """Stands for the generator, which takes long to compile."""
    views = jax.random.uniform(key, (3, 3, *config.image_size))
    seen = views > 0.2
    return Sample(views, jnp.zeros((3, 3, 2)), views[1, 1], seen, seen[1, 1])


@pytest.fixture
def generator(monkeypatch):
    monkeypatch.setattr(sources, "generate", cheap_scene)


@pytest.mark.usefixtures("generator")
def test_procedural_light_fields_are_numbered_by_the_seed():
    config = SceneConfig(image_size=(4, 6), grid=(3, 3))
    batch = procedural_source(config, 3, seed=5)(2)
    for place in range(3):
        key = jax.random.fold_in(jax.random.key(5), 2 * 3 + place)
        expected = cheap_scene(key, config)
        jax.tree.map(
            lambda found, truth, place=place: np.testing.assert_array_equal(found[place], truth),
            batch,
            expected,
        )


@pytest.mark.usefixtures("generator")
def test_procedural_light_fields_are_augmented_alike_for_the_same_step():
    config = SceneConfig(image_size=(8, 8), grid=(3, 3))
    augmentation = AugmentationConfig(crop=(6, 6))
    first, second = (procedural_source(config, 2, 5, augmentation=augmentation) for _ in range(2))
    first(0)
    assert first(1).views.shape == (2, 3, 3, 6, 6)
    jax.tree.map(np.testing.assert_array_equal, first(1), second(1))


def test_an_empty_batch_is_refused():
    with pytest.raises(InputError, match="batch_size is 0"):
        procedural_source(SceneConfig(), 0, seed=0)


def test_light_fields_that_are_kept_are_those_that_would_be_rendered():
    config = SceneConfig(image_size=(12, 12), grid=(3, 3), sheets=1, solids=1, rays=1)
    made = [procedural_source(config, 2, seed=5)(step) for step in range(3)]
    made = jax.tree.map(lambda *fields: np.concatenate(fields), *made)
    source, again = (kept_source(config, 5, 2, seed=5) for _ in range(2))
    seen = set()
    for step in (3, 0, *range(12)):
        batch = source(step)
        jax.tree.map(np.testing.assert_array_equal, batch, again(step))
        for each in range(2):
            (number,) = np.flatnonzero(
                (made.disparity == np.asarray(batch.disparity[each])).all((1, 2))
            )
            one, other = (
                jax.tree.map(lambda field, i=i: np.asarray(field[i]), fields)
                for fields, i in ((batch, each), (made, number))
            )
            np.testing.assert_allclose(one.views, other.views, atol=0.5001 / 255)
            jax.tree.map(
                np.testing.assert_array_equal, one._replace(views=0), other._replace(views=0)
            )
            seen.add(int(number))
    assert seen == set(range(5))  # the sixth was rendered with the fifth, but not asked for


def test_light_fields_that_are_kept_are_varied_from_step_to_step():
    config = SceneConfig(image_size=(12, 12), grid=(3, 3), sheets=1, solids=1, rays=1)
    augmentation = AugmentationConfig(crop=(8, 8))
    source = kept_source(config, 1, 2, seed=5, augmentation=augmentation)
    first, second = source(0), source(1)
    assert first.views.shape == (2, 1, 9, 8, 8)
    assert not np.array_equal(first.views, second.views)
    assert not np.array_equal(first.views[0], first.views[1])


def test_no_light_fields_to_keep_are_refused():
    with pytest.raises(InputError, match="at least 1"):
        kept_source(SceneConfig(), 0, 2, seed=0)


def test_more_light_fields_than_there_is_memory_for_are_told():
    source = kept_source(SceneConfig(image_size=(12, 12), grid=(3, 3), rays=1), 10**13, 2, seed=0)
    with pytest.raises(InputError, match=r"to keep take \d+ GB, which the device has not"):
        source(0)


def test_views_differ_from_step_to_step_as_often_as_asked():
    images = np.zeros((2, 5, 5, 2, 2), np.float32)
    offsets = np.stack([grid(5, 5)] * 2)
    whole = Sample(images, offsets, images[:, 0, 0], images == 0, images[:, 0, 0] == 0)
    options = {"selections": {(3, 3): 2.0, "cross": 1.0, "all": 1.0, "star": 0.0}, "seed": 0}
    source = random_views(lambda step: whole, **options)
    grids = [source(step).views.shape[1:3] for step in range(400)]
    for arrangement, expected in {(3, 3): 200, (1, 9): 100, (5, 5): 100}.items():
        assert abs(grids.count(arrangement) - expected) < 4 * np.sqrt(expected)
    again = random_views(lambda step: whole, **options)
    assert [again(step).views.shape[1:3] for step in (7, 3)] == [grids[7], grids[3]]


def test_no_selection_of_views_is_refused():
    with pytest.raises(InputError, match="selections"):
        random_views(numbered(1), {}, seed=0)
