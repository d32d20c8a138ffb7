"""Prepared light fields: rounding, symmetries, folders, and the choice of patches."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from occjax.data.config import AugmentationConfig
from occjax.data.pool import read_sample, render_pool
from occjax.data.procedural import SceneConfig
from occjax.data.samples import to_device
from occjax.data.scenes import Scene
from occjax.data.transforms import transform_sample
from occjax.errors import InputError
from occjax.io.run_folder import read_description, write_description
from occjax.lightfield import view_offsets
from occjax.models import preset
from occjax.models.proposal import RefinementConfig, ResidualConfig, SelectorConfig
from occjax.training import prepared
from occjax.training.prepared import (
    DISPARITY_STEPS,
    PackedProposals,
    PatchConfig,
    PreparedSample,
    pack,
    prepared_source,
    unpack,
)
from occjax.view_selection import select_from_grid
from tests.reference.variables import random_proposals, random_variables

NETWORK = preset("proposal_small")
OFFSETS = NETWORK.proposals.offsets
AUGMENTATION = AugmentationConfig(crop=(16, 16), gamma=1.0, contrast=1.0, brightness=0.0, noise=0.0)
"""Patches without a change of tone: all tests share one compiled program of the proposals."""

VARIABLES = random_variables(NETWORK)

SCENES = SceneConfig(image_size=(32, 32), grid=(3, 3), sheets=2, solids=1, rays=1)


@pytest.fixture(scope="module")
def pool(tmp_path_factory):
    """Render a pool of three light fields."""
    folder = tmp_path_factory.mktemp("pools") / "pool"
    render_pool(folder, 3, SCENES, seed=0)
    return folder


@pytest.fixture(scope="module")
def sample(pool):
    return to_device(read_sample(pool / "000001.npz"))


def prepare(sample, variables=None):
    sample = prepared.prepare(jax.random.key(0), sample, NETWORK, AUGMENTATION, variables)
    return jax.tree.map(np.asarray, sample)


def cost_roots(proposals):
    """Return the square roots of the costs, which are stored."""
    return np.sqrt(np.asarray(proposals.costs.channels, np.float32))


def test_unpacked_proposals_equal_the_packed_ones_up_to_rounding(tolerance):
    proposals = random_proposals(5, 7)
    again = unpack(pack(proposals))
    np.testing.assert_array_equal(again.disparity, proposals.disparity)
    np.testing.assert_allclose(again.proposed, proposals.proposed, atol=0.51 / DISPARITY_STEPS)
    np.testing.assert_allclose(again.centre, np.clip(proposals.centre, 0, 1), **tolerance("8 bit"))
    np.testing.assert_allclose(cost_roots(again), cost_roots(proposals), atol=0.51 / 255 + 5e-4)
    np.testing.assert_allclose(again.log_variance, proposals.log_variance, **tolerance("float16"))
    np.testing.assert_allclose(
        again.peak_probability, proposals.peak_probability, **tolerance("float16")
    )


@pytest.mark.parametrize("symmetry", ["transpose", "flip_rows", "flip_columns"])
def test_turning_prepared_light_fields_equals_preparing_turned_ones(symmetry, sample):
    """The second-best disparity of the search is not compared: noise decides which one it is."""

    original = prepare(sample)
    turned = prepared.transform_prepared(original, symmetry, OFFSETS).packed
    expected = prepare(transform_sample(sample, symmetry)).packed
    difference = np.abs(turned.disparity - expected.disparity)
    # Planes are fitted along columns, then along rows; transposed, in the other order.
    assert np.median(difference) < 5e-3
    same = difference < 5e-3
    turned_roots, expected_roots = cost_roots(unpack(turned)), cost_roots(unpack(expected))
    costs = np.abs(turned_roots - expected_roots)
    assert np.median(costs[0][:, same]) < 0.01
    # The neighbours propose from their changed offsets.
    moved = np.abs(unpack(turned).proposed - unpack(expected).proposed)[1:9]
    unmoved = np.abs(unpack(original.packed).proposed - unpack(expected).proposed)[1:9]
    assert np.median(moved[:, same]) < 0.25 * np.median(unmoved[:, same])
    assert np.median(costs[1:9][..., same]) < 0.02
    # The costs of opposite sectors differ: in another order they would not agree.
    swapped = np.abs(turned_roots[0, [4, 5, 6, 7, 0, 1, 2, 3]] - expected_roots[0, :8])
    assert swapped[:, same].mean() > 3 * costs[0, :8][:, same].mean()


def test_a_source_gives_the_same_patches_for_the_same_step(pool, tmp_path):
    folder = tmp_path / "kept"
    options = {"batch_size": 2, "augmentation": AUGMENTATION}
    first = prepared_source([pool], folder, NETWORK, seed=3, **options)
    batch = first(0)
    assert len(list(folder.glob("*.npz"))) == 2
    assert batch.packed.costs.shape == (2, 10, 13, 16, 16)
    assert batch.disparity.shape == (2, 16, 16)
    first(1)  # prepares the last light field
    before = {path: path.read_bytes() for path in folder.iterdir()}
    again = prepared_source([pool], folder, NETWORK, seed=3, **options)
    jax.tree.map(np.testing.assert_array_equal, batch, again(0))
    last = jax.tree.map(lambda field: field[1:], batch)
    jax.tree.map(np.testing.assert_array_equal, again(0, slice(1, 2)), last)
    assert not np.array_equal(batch.disparity, again(4).disparity)
    other = prepared_source([pool], folder, NETWORK, seed=4, **options)
    assert not np.array_equal(batch.disparity, other(0).disparity)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


def test_only_settings_that_proposals_depend_on_must_be_the_same(pool, tmp_path):
    folder = tmp_path / "kept"
    options = {"batch_size": 1, "seed": 3, "augmentation": AUGMENTATION}
    prepared_source([pool], folder, NETWORK, **options)
    prepared_source([pool], folder, replace(NETWORK, selector=SelectorConfig(8, (8,))), **options)
    other = replace(NETWORK, refinement=RefinementConfig(steps=1))
    with pytest.raises(InputError, match=r"refinement\.steps is 3, not 1"):
        prepared_source([pool], folder, other, **options)
    description = read_description(folder / "preparation.json")
    write_description(folder / "preparation.json", {**description, "version": "0.0.1"})
    with pytest.raises(InputError, match=r"version is 0\.0\.1, not"):
        prepared_source([pool], folder, NETWORK, **options)


def test_several_pools_are_used_like_one(pool, tmp_path, tolerance):
    other = tmp_path / "other"
    render_pool(other, 2, SCENES, seed=1)
    options = {"batch_size": 5, "seed": 0, "augmentation": replace(AUGMENTATION, crop=(32, 32))}
    batch = prepared_source([pool, other], tmp_path / "kept", NETWORK, **options)(0)
    means = sorted(float(disparity.mean()) for disparity in batch.disparity)
    paths = [path for folder in (pool, other) for path in folder.glob("*.npz")]
    scale = 1 / NETWORK.reach  # offsets of 1 are scaled to the network's reach
    expected = sorted(scale * read_sample(path).disparity.mean() for path in paths)
    np.testing.assert_allclose(means, expected, **tolerance("float32"))


@pytest.mark.parametrize(
    ("crop", "message"),
    [
        (24, "crop is 24x24 pixels; .* multiples of 16 pixels"),
        (64, "smaller than the crop"),
    ],
)
def test_crops_that_do_not_fit_are_refused(pool, tmp_path, crop, message):
    augmentation = replace(AUGMENTATION, crop=(crop, crop))
    with pytest.raises(InputError, match=message):
        prepared_source([pool], tmp_path, NETWORK, batch_size=1, seed=0, augmentation=augmentation)(
            0
        )


def test_damaged_files_and_folders_of_something_else_are_named(pool, tmp_path):
    options = {"batch_size": 3, "seed": 0, "augmentation": AUGMENTATION}
    source = prepared_source([pool], tmp_path / "kept", NETWORK, **options)
    source(0)
    (tmp_path / "kept" / "000002.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"000002\.npz: cannot be decoded"):
        source(0)
    with pytest.raises(InputError, match="neither empty nor prepared"):
        prepared_source([pool], tmp_path, NETWORK, **options)


def test_the_patch_with_most_correctable_pixels_is_used():
    """The share of correctable pixels is that of the best of four places, drawn independently."""
    generator = np.random.default_rng(0)
    disparity = np.zeros((12, 64), np.float32)
    disparity[:, 48:] = 0.5  # wrong there, where one proposal is correct
    packed = PackedProposals(
        centre=np.zeros((12, 64), np.uint8),
        disparity=disparity,
        proposed=np.zeros((2, 12, 64), np.int16),
        costs=np.zeros((2, 13, 12, 64), np.uint8),
        log_variance=np.zeros((12, 64), np.float16),
        peak_probability=np.zeros((12, 64), np.float16),
    )
    whole = PreparedSample(packed, np.zeros((12, 64), np.float32), disparity > -1)
    augmentation = AugmentationConfig(crop=(12, 12), flips=False, turns=False)
    drawn = [
        prepared.random_patch(generator, whole, (), augmentation, PatchConfig()) for _ in range(200)
    ]
    share = np.mean([patch.packed.disparity.mean() / 0.5 for patch in drawn])
    places = generator.integers(0, 53, (4000, 4))
    covered = np.clip(places + 12 - 48, 0, 12) / 12
    assert abs(share - covered.max(1).mean()) < 0.06
    assert share > 2 * covered.mean()


def test_scenes_of_folders_have_their_share(pool, tmp_path, tolerance):
    scenes = [flat_scene(disparity) for disparity in (5.0, 6.0)]  # in the pool at most 4
    options = {"seed": 0, "augmentation": replace(AUGMENTATION, crop=(32, 32))}
    parts = {"scenes": scenes, "weights": (1.0, 2.0)}
    source = prepared_source([pool], tmp_path / "both", NETWORK, 3, **options, **parts)
    scale = 1 / NETWORK.reach
    for step in range(2):
        means = np.sort(source(step).disparity.mean((1, 2))) / scale
        assert means[0] < 4.0
        np.testing.assert_allclose(means[1:], [5.0, 6.0], **tolerance("absolute"))
    alone = prepared_source([], tmp_path / "alone", NETWORK, 2, **options, scenes=scenes)
    np.testing.assert_allclose(
        np.sort(alone(0).disparity.mean((1, 2))) / scale, [5, 6], **tolerance("absolute")
    )
    changed = [flat_scene(1.0), scenes[1]]
    with pytest.raises(InputError, match=r"scene_checksums\.0_flat is"):
        prepared_source([], tmp_path / "alone", NETWORK, 2, **options, scenes=changed)
    with pytest.raises(InputError, match="no light fields to prepare"):
        prepared_source([], tmp_path / "none", NETWORK, 2, **options)


def flat_scene(disparity):
    shape, offsets = (32, 32), view_offsets(3, 3)
    views = np.random.default_rng(0).integers(0, 256, (3, 3, *shape, 3), np.uint8)
    selected = select_from_grid(offsets, NETWORK.views)
    return Scene(
        name="flat",
        views=views[selected],
        offsets=offsets[selected],
        disparity=np.full(shape, disparity, np.float32),
        valid=np.ones(shape, bool),
        masked=False,
    )


@pytest.mark.parametrize("symmetry", ["transpose", "flip_rows", "flip_columns"])
def test_turning_prepared_volumes_equals_preparing_turned_light_fields(symmetry, sample):
    original = prepare(sample, VARIABLES)
    turned = prepared.transform_prepared(original, symmetry, OFFSETS).packed
    expected = prepare(transform_sample(sample, symmetry), VARIABLES).packed
    # The order of the sums, and the selection by random weights, change the disparity a little.
    same = np.abs(turned.disparity - expected.disparity) < 5e-3
    assert same.mean() > 0.2
    for name in ("centre", "reference", "relative"):
        one, other, before = (
            np.float32(getattr(packed, name))[..., same]
            for packed in (turned, expected, original.packed)
        )
        assert np.median(np.abs(one - other)) < 0.01
        assert np.mean(np.abs(one - other)) < 0.5 * np.mean(np.abs(before - other))


def test_volumes_belong_to_the_selector_that_computed_them(pool, tmp_path):
    options = {"batch_size": 3, "seed": 0, "augmentation": AUGMENTATION}
    folder = tmp_path / "volumes"
    batch = prepared_source([pool], folder, NETWORK, **options, variables=VARIABLES)(0)
    candidates = len(NETWORK.residual.candidates)
    assert batch.packed.relative.shape == (3, 4, candidates, 16, 16)
    assert batch.packed.relative.dtype == np.float16
    np.testing.assert_array_equal(batch.packed.relative[:, :, candidates // 2], 0.0)
    wider = replace(NETWORK, residual=ResidualConfig(widths=(8,)))  # another residual, same inputs
    again = prepared_source([pool], folder, wider, **options, variables=VARIABLES)(0)
    jax.tree.map(np.testing.assert_array_equal, batch, again)
    with pytest.raises(InputError, match="selector_checksum is"):
        prepared_source(
            [pool], folder, NETWORK, **options, variables=random_variables(NETWORK, seed=1)
        )
    with pytest.raises(InputError, match=r"network\.selector is absent"):
        prepared_source([pool], folder, NETWORK, **options)
