"""Pools: what is stored, what is rendered again, and the order of the light fields."""

import json

import jax
import numpy as np
import pytest

from occjax.data import pool
from occjax.data.config import AugmentationConfig
from occjax.data.pool import light_field_files, pool_source, read_sample, render_pool, write_sample
from occjax.data.procedural import SceneConfig
from occjax.errors import InputError
from tests.conftest import TOLERANCE
from tests.data.scenes import cheap_scene

CONFIG = SceneConfig(image_size=(5, 11), grid=(3, 3))

RENDERED = []


@pytest.fixture(autouse=True)
def generator(monkeypatch):
    RENDERED.clear()

    def generate(key, config):
        RENDERED.append(key)
        return cheap_scene(key, config)

    monkeypatch.setattr(pool, "generate", generate)


def expected(number, seed=3):
    """Light field ``number`` of a pool, by the documented numbering."""
    return cheap_scene(jax.random.fold_in(jax.random.key(seed), number), CONFIG)


def assert_stored(found, sample):
    np.testing.assert_allclose(found.views, sample.views, **TOLERANCE["8 bit"])
    for field in ("offsets", "disparity", "visibility", "valid"):
        np.testing.assert_array_equal(getattr(found, field), getattr(sample, field))
        assert getattr(found, field).dtype == getattr(sample, field).dtype


def test_a_sample_is_read_as_it_was_written_except_for_rounding_to_8_bits(tmp_path):
    sample = expected(0)
    write_sample(tmp_path / "one.npz", sample)
    assert_stored(read_sample(tmp_path / "one.npz"), sample)
    # One byte for a grey, four for a disparity, one bit for a visibility; the rest are headers.
    assert (tmp_path / "one.npz").stat().st_size < 9 * 55 + 4 * 55 + 10 * 5 * 2 + 72 + 2000


def test_only_missing_light_fields_are_rendered(tmp_path):
    render_pool(tmp_path, 4, CONFIG, 3)
    (tmp_path / "000001.npz").unlink()
    assert len(light_field_files(tmp_path)) == 1
    kept = (tmp_path / "000002.npz").stat().st_mtime_ns
    RENDERED.clear()
    render_pool(tmp_path, 6, CONFIG, 3)
    assert len(RENDERED) == 3
    assert (tmp_path / "000002.npz").stat().st_mtime_ns == kept
    assert len(light_field_files(tmp_path)) == 6
    assert_stored(read_sample(tmp_path / "000001.npz"), expected(1))
    assert_stored(read_sample(tmp_path / "000005.npz"), expected(5))


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        ("seed", 4, "seed is 4, not 3"),
        ("scenes", {"image_size": [5, 12]}, "image_size"),
        ("version", "0.0.1", "version is 0.0.1"),
        ("photographs", None, "photographs is None, not absent"),
    ],
)
def test_a_pool_of_other_settings_is_refused_and_the_difference_named(
    tmp_path, field, value, named
):
    render_pool(tmp_path, 1, CONFIG, 3)
    description = json.loads((tmp_path / "pool.json").read_text())
    (tmp_path / "pool.json").write_text(json.dumps({**description, field: value}))
    with pytest.raises(InputError, match=named):
        render_pool(tmp_path, 2, CONFIG, 3)
    assert len(light_field_files(tmp_path)) == 1


def test_each_light_field_is_used_once_before_any_is_used_again(tmp_path):
    render_pool(tmp_path, 5, CONFIG, 3)
    source = pool_source(tmp_path, 3, seed=1)
    drawn = [float(d[0, 0]) for step in range(5) for d in source(step).disparity]
    rounds = [drawn[start : start + 5] for start in range(0, 15, 5)]
    assert all(len(set(once)) == 5 for once in rounds)
    assert len({tuple(once) for once in rounds}) == 3


def test_the_batch_of_a_step_does_not_depend_on_earlier_requests(tmp_path):
    render_pool(tmp_path, 5, CONFIG, 3)
    config = AugmentationConfig(crop=(4, 4))
    source = pool_source(tmp_path, 2, seed=1, augmentation=config)
    batches = [source(step) for step in range(4)]
    again = pool_source(tmp_path, 2, seed=1, augmentation=config)
    for step in (3, 0, 2):
        jax.tree.map(np.testing.assert_array_equal, again(step), batches[step])
        last = jax.tree.map(lambda field: field[1:], batches[step])
        jax.tree.map(np.testing.assert_array_equal, again(step, slice(1, 2)), last)
    assert batches[0].views.shape == (2, 1, 9, 4, 4)
    other = pool_source(tmp_path, 2, seed=2, augmentation=config)(0)
    assert not np.array_equal(other.views, batches[0].views)


def test_views_of_a_pool_can_be_selected(tmp_path):
    render_pool(tmp_path, 1, CONFIG, 3)
    batch = pool_source(tmp_path, 4, seed=0, views="cross")(0)
    assert batch.views.shape == (4, 1, 5, 5, 11)
    np.testing.assert_array_equal(batch.disparity, np.stack([expected(0).disparity] * 4))


def test_a_light_field_drawn_twice_is_varied_differently(tmp_path):
    render_pool(tmp_path, 1, CONFIG, 3)
    batch = pool_source(tmp_path, 2, seed=1, augmentation=AugmentationConfig(turns=False))(0)
    assert not np.allclose(batch.views[0], batch.views[1])


def test_folders_that_are_no_pool_are_refused(tmp_path):
    with pytest.raises(InputError, match="is not a pool"):
        pool_source(tmp_path, 2, seed=0)
    np.savez(tmp_path / "results.npz", views=np.zeros(3))
    with pytest.raises(InputError, match="choose another folder"):
        render_pool(tmp_path, 1, CONFIG, 3)
    (tmp_path / "pool.json").write_text("{")
    with pytest.raises(InputError, match=r"pool\.json: cannot be decoded"):
        render_pool(tmp_path, 1, CONFIG, 3)
    with pytest.raises(InputError, match="is an empty pool"):
        pool_source(tmp_path, 2, seed=0)


def test_empty_pools_and_batches_are_refused(tmp_path):
    with pytest.raises(InputError, match="at least 1"):
        render_pool(tmp_path, 0, CONFIG, 3)
    with pytest.raises(InputError, match="batch_size"):
        pool_source(tmp_path, 0, seed=0)


@pytest.mark.parametrize("damage", [b"", b"not a zip file", None])
def test_a_damaged_file_is_named(tmp_path, damage):
    render_pool(tmp_path, 1, CONFIG, 3)
    path = tmp_path / "000000.npz"
    path.write_bytes(path.read_bytes()[:700] if damage is None else damage)
    with pytest.raises(InputError, match=r"000000\.npz: cannot be decoded"):
        pool_source(tmp_path, 1, seed=0)(0)
