"""Light fields prepared for a choice: what is kept, and that turning them is turning the views."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data import transforms
from occjax.data.augmentation import AugmentationConfig
from occjax.data.pool import render_pool
from occjax.data.scene_config import SceneConfig
from occjax.errors import InputError
from occjax.io.claims import read_description, write_description
from occjax.models import Choice, OccCasNet, preset
from occjax.training import prepared
from occjax.training.prepared import FINENESS, pack, prepared_source, unpack

NETWORK = preset("light_small")
AUGMENTATION = AugmentationConfig(crop=(16, 16), noise=0.0)
SCENES = SceneConfig(image_size=(32, 32), grid=(3, 3), sheets=2, solids=1, rays=1)


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pools") / "pool"
    render_pool(folder, 3, SCENES, seed=0, progress=False)
    return folder


@pytest.fixture(scope="module")
def sample(pool):
    return prepared.to_device(prepared.read_sample(pool / "000001.npz"))


@jax.jit
def proposals_of(sample):
    network = OccCasNet(NETWORK)
    return network.apply({}, sample.views, sample.offsets, method="propose")


@pytest.fixture(scope="module")
def proposals(sample):
    return proposals_of(sample)


def roots(proposals):
    """Of the costs, in which they are kept."""
    return np.sqrt(np.asarray(proposals.costs, np.float32))


def test_what_is_packed_is_what_is_unpacked(proposals):
    again = unpack(pack(proposals))
    np.testing.assert_array_equal(again.disparity, proposals.disparity)
    np.testing.assert_allclose(again.proposed, proposals.proposed, atol=0.51 / FINENESS)
    np.testing.assert_allclose(again.centre, np.clip(proposals.centre, 0, 1), atol=0.51 / 255)
    np.testing.assert_allclose(roots(again), roots(proposals), atol=0.51 / 255 + 5e-4)
    np.testing.assert_allclose(again.spread, proposals.spread, rtol=1e-3)


@pytest.mark.parametrize("name", ["transpose", "flip_rows", "flip_columns"])
def test_turning_what_is_prepared_is_preparing_what_is_turned(name, sample, proposals):
    """All but the second candidate, for whose choice noise is enough."""

    def packed(proposals):
        return jax.tree.map(
            np.asarray, prepared.PreparedSample(pack(proposals), sample.disparity, sample.valid)
        )

    turned = getattr(prepared, name)(packed(proposals), NETWORK.stages[1].neighbours).packed
    expected = packed(proposals_of(getattr(transforms, name)(sample))).packed
    difference = np.abs(turned.disparity - expected.disparity)
    # Planes are fitted along columns, then along rows: transposed, the other way about.
    assert np.median(difference) < 5e-3
    same = difference < 5e-3
    costs = np.abs(roots(unpack(turned)) - roots(unpack(expected)))
    assert np.median(costs[0][:, same]) < 0.01
    # Each neighbour proposes from where it now is.
    moved = np.abs(unpack(turned).proposed - unpack(expected).proposed)[1:9]
    unmoved = np.abs(unpack(packed(proposals).packed).proposed - unpack(expected).proposed)[1:9]
    assert np.median(moved[:, same]) < 0.25 * np.median(unmoved[:, same])
    assert np.median(costs[1:9][..., same]) < 0.02
    # The costs of the sectors tell them apart: in the order they had they would not agree.
    swapped = np.abs(
        roots(unpack(turned))[0, [4, 5, 6, 7, 0, 1, 2, 3]] - roots(unpack(expected))[0, :8]
    )
    assert swapped[:, same].mean() > 3 * costs[0, :8][:, same].mean()


def test_a_source_gives_the_same_patches_for_the_same_step_and_keeps_what_it_made(pool, tmp_path):
    def source():
        return prepared_source(
            [pool], tmp_path / "kept", NETWORK, batch_size=2, seed=3, augmentation=AUGMENTATION
        )

    first = source()(0)
    kept = sorted(path.name for path in (tmp_path / "kept").glob("*.npz"))
    assert len(kept) == 2
    again = source()(0)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert first.packed.costs.shape == (2, 10, 13, 16, 16)
    assert first.disparity.shape == (2, 16, 16)
    assert not np.array_equal(first.disparity, source()(4).disparity)


def test_another_seed_draws_other_patches_of_what_was_prepared(pool, tmp_path):
    options = {"batch_size": 2, "augmentation": AUGMENTATION}
    first = prepared_source([pool], tmp_path / "kept", NETWORK, seed=3, **options)
    for step in range(2):
        first(step)  # prepares all
    before = {path: path.read_bytes() for path in (tmp_path / "kept").iterdir()}
    other = prepared_source([pool], tmp_path / "kept", NETWORK, seed=4, **options)
    assert not np.array_equal(first(0).disparity, other(0).disparity)
    assert {path: path.read_bytes() for path in (tmp_path / "kept").iterdir()} == before


def test_wider_layers_take_what_was_prepared_for_narrow_ones(pool, tmp_path):
    folder = tmp_path / "kept"
    options = {"batch_size": 1, "seed": 3, "augmentation": AUGMENTATION}
    prepared_source([pool], folder, NETWORK, **options)(0)
    search, choice = NETWORK.stages
    wide = replace(NETWORK, stages=(search, replace(choice, aggregation=Choice(8, (8,)))))
    prepared_source([pool], folder, wide, **options)
    other = replace(NETWORK, stages=(search, replace(choice, plane_steps=1)))
    with pytest.raises(InputError, match="plane_steps is 3, not 1"):
        prepared_source([pool], folder, other, **options)


def test_what_another_version_prepared_is_refused(pool, tmp_path):
    options = {"batch_size": 1, "seed": 3, "augmentation": AUGMENTATION}
    prepared_source([pool], tmp_path, NETWORK, **options)
    description = read_description(tmp_path / "preparation.json")
    write_description(tmp_path / "preparation.json", {**description, "version": "0.0.1"})
    with pytest.raises(InputError, match=r"version is 0\.0\.1, not"):
        prepared_source([pool], tmp_path, NETWORK, **options)


def test_several_pools_are_drawn_from_as_one(pool, tmp_path):
    other = tmp_path / "other"
    render_pool(other, 2, SCENES, seed=1, progress=False)
    options = {"batch_size": 5, "seed": 0, "augmentation": replace(AUGMENTATION, crop=(32, 32))}
    batch = prepared_source([pool, other], tmp_path / "kept", NETWORK, **options)(0)
    means = sorted(float(disparity.mean()) for disparity in batch.disparity)
    samples = [
        *(pool / f"{n:06d}.npz" for n in range(3)),
        other / "000000.npz",
        other / "000001.npz",
    ]
    scale = 1 / NETWORK.reach  # offsets of 1 are scaled to the network's reach
    expected = sorted(scale * prepared.read_sample(path).disparity.mean() for path in samples)
    np.testing.assert_allclose(means, expected, rtol=1e-4, atol=1e-5)


def test_folders_of_something_else_and_unfit_augmentation_are_refused(pool, tmp_path):
    (tmp_path / "letter.txt").write_text("dear", encoding="utf-8")
    options = {"batch_size": 1, "seed": 0}
    with pytest.raises(InputError, match="neither empty nor prepared"):
        prepared_source([pool], tmp_path, NETWORK, augmentation=AUGMENTATION, **options)
    with pytest.raises(InputError, match="prepared whole"):
        prepared_source(
            [pool],
            tmp_path / "a",
            NETWORK,
            augmentation=replace(AUGMENTATION, shear=1.0),
            **options,
        )
    odd = replace(AUGMENTATION, crop=(24, 24))
    with pytest.raises(InputError, match="multiples of 16 pixels"):
        prepared_source([pool], tmp_path / "a", NETWORK, augmentation=odd, **options)
    large = replace(AUGMENTATION, crop=(64, 64))
    with pytest.raises(InputError, match="smaller than the crop"):
        prepared_source([pool], tmp_path / "b", NETWORK, augmentation=large, **options)(0)


def test_a_damaged_file_is_named(pool, tmp_path):
    source = prepared_source(
        [pool], tmp_path, NETWORK, batch_size=3, seed=0, augmentation=AUGMENTATION
    )
    source(0)
    (tmp_path / "000002.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"000002\.npz: is damaged"):
        source(0)
    assert json.loads((tmp_path / "preparation.json").read_text(encoding="utf-8"))["seed"] == 0


def test_the_patch_with_most_to_mend_is_taken():
    generator = np.random.default_rng(0)
    disparity = np.zeros((12, 64), np.float32)
    disparity[:, 48:] = 0.5  # wrong there, and one proposal is right
    packed = prepared.Packed(
        np.zeros((12, 64), np.uint8),
        disparity,
        np.zeros((2, 12, 64), np.int16),
        np.zeros((13, 2, 12, 64), np.uint8),
        np.zeros((2, 12, 64), np.float16),
    )
    whole = prepared.PreparedSample(packed, np.zeros((12, 64), np.float32), disparity > -1)
    augmentation = AugmentationConfig(crop=(12, 12), flips=False, turns=False)
    drawn = [prepared.patch(generator, whole, (), augmentation) for _ in range(200)]
    share = np.mean([patch.packed.disparity.mean() / 0.5 for patch in drawn])
    places = generator.integers(0, 53, (4000, 4))
    covered = np.clip(places + 12 - 48, 0, 12) / 12
    assert abs(share - covered.max(1).mean()) < 0.06
    assert share > 2 * covered.mean()
    assert isinstance(drawn[0].disparity, np.ndarray)
    assert jnp.asarray(drawn[0].disparity).shape == (12, 12)
