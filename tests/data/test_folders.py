"""Scenes read from folders, and sources of their patches."""

import imageio.v3 as imageio
import jax
import numpy as np
import pytest

from occjax.data.config import AugmentationConfig
from occjax.data.folders import folder_source
from occjax.data.scenes import Scene, load_scenes
from occjax.errors import InputError
from occjax.io import write_pfm
from occjax.lightfield import view_offsets
from tests.data.scenes import star, warped

SIZE = (24, 26)

pytestmark = pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")


def write_scene(folder, *, views=3, mask=None, seed=0, truth=0.5):
    """An HCI folder of random views; returns them."""
    folder.mkdir(parents=True)
    images = np.random.default_rng(seed).integers(0, 256, (views**2, *SIZE, 3), np.uint8)
    for number, image in enumerate(images):
        imageio.imwrite(folder / f"input_Cam{number:03d}.png", image)
    write_pfm(folder / "gt_disp_lowres.pfm", np.full(SIZE, truth, np.float32))
    if mask is not None:
        imageio.imwrite(folder / "mask.png", mask)
    return images.reshape(views, views, *SIZE, 3)


def numbered_scene(number=0, size=(20, 22), offsets=None):
    """A scene whose views show row, column and number of the scene as their three colours."""
    offsets = view_offsets(3, 3) if offsets is None else offsets
    y, x = np.mgrid[: size[0], : size[1]]
    image = np.stack([y, x, np.full(size, number)], axis=-1).astype(np.uint8)
    views = np.tile(image, (*offsets.shape[:2], 1, 1, 1))
    disparity = (100.0 * y + x).astype(np.float32)
    return Scene(f"scene {number}", views, offsets, disparity, disparity >= 0, False)


def test_a_folder_is_read_in_eight_bits_with_its_ground_truth(tmp_path):
    images = write_scene(tmp_path / "one", truth=0.75)
    (scene,) = load_scenes([tmp_path / "one"])
    assert scene.views.dtype == np.uint8
    np.testing.assert_array_equal(scene.views, images)
    np.testing.assert_array_equal(scene.disparity, 0.75)
    np.testing.assert_array_equal(scene.offsets, view_offsets(3, 3))
    assert scene.valid.all()
    assert not scene.masked
    assert scene.name == "one"


def test_scenes_are_found_in_a_folder_of_folders_in_order(tmp_path):
    for name in ("b", "a", "c"):
        write_scene(tmp_path / name)
    (tmp_path / "notes").mkdir()
    assert [scene.name for scene in load_scenes([tmp_path])] == ["a", "b", "c"]
    both = load_scenes([tmp_path / "c", str(tmp_path / "a")])
    assert [scene.name for scene in both] == ["c", "a"]


def test_selected_views_keep_their_offsets(tmp_path):
    images = write_scene(tmp_path / "one", views=5)
    (scene,) = load_scenes([tmp_path / "one"], views="star")
    np.testing.assert_array_equal(scene.offsets, star(5))
    for place, offset in enumerate(star(5)[0].astype(int)):
        np.testing.assert_array_equal(scene.views[0, place], images[tuple(offset + 2)])


def test_masked_and_infinite_ground_truth_is_not_valid(tmp_path):
    mask = np.zeros(SIZE, np.uint8)
    mask[3, 5] = 255
    write_scene(tmp_path / "one", mask=mask)
    truth = np.full(SIZE, 0.5, np.float32)
    truth[7, 2] = np.inf
    write_pfm(tmp_path / "one" / "gt_disp_lowres.pfm", truth)
    (scene,) = load_scenes([tmp_path / "one"])
    assert scene.masked
    expected = np.ones(SIZE, bool)
    expected[3, 5] = expected[7, 2] = False
    np.testing.assert_array_equal(scene.valid, expected)
    assert np.isfinite(scene.disparity).all()


def test_folders_without_usable_scenes_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_scenes([tmp_path / "nowhere"])
    with pytest.raises(InputError, match="gt_disp_lowres"):
        load_scenes([tmp_path])
    write_scene(tmp_path / "one", mask=np.zeros((4, 4), np.uint8))
    with pytest.raises(InputError, match=r"mask\.png: is \[4, 4\]"):
        load_scenes([tmp_path])


def test_grey_is_the_weighted_mean_of_the_colours(tolerance):
    scene = numbered_scene(7)
    grey = scene.grey(np.s_[2:5, 3:5], np.array([1.0, 2.0, 1.0]))
    y, x = np.mgrid[2:5, 3:5]
    np.testing.assert_allclose(grey[1, 2], (y + 2 * x + 7) / 4 / 255, **tolerance("relative"))


GEOMETRY = AugmentationConfig(
    crop=(9, 9), flips=False, turns=False, gamma=1.0, contrast=1.0, brightness=0.0, noise=0.0
)
"""Crops alone."""


def test_windows_are_the_same_part_of_views_and_ground_truth_in_random_grey(tolerance):
    scenes = [numbered_scene(0), numbered_scene(60)]
    source = folder_source(scenes, 6, seed=0, augmentation=GEOMETRY, threads=0)
    corners, numbers, greys = set(), set(), []
    for batch in map(source, range(5)):
        for views, disparity in zip(batch.views, np.asarray(batch.disparity), strict=True):
            top, left = divmod(int(disparity[0, 0]), 100)
            y, x = np.mgrid[top : top + 9, left : left + 9]
            np.testing.assert_allclose(disparity, 100 * y + x)
            # Grey is linear in the colours, which are row, column and number of the scene.
            colours = np.stack([y, x, np.ones((9, 9))], axis=-1).reshape(-1, 3) / 255
            (red, green, rest), *_ = np.linalg.lstsq(colours, np.ravel(views[2, 1]), rcond=None)
            np.testing.assert_allclose(
                colours @ [red, green, rest], np.ravel(views[0, 2]), **tolerance("absolute")
            )
            corners.add((top, left))
            numbers.add(round(rest / (1 - red - green)))
            greys.append((red, green, 1 - red - green))
    assert numbers == {0, 60}
    assert len(corners) > 15
    # Weights are 0.05 + U(0, 1) each: no colour weighs more than 1.05 / 1.15 of all.
    assert 0.02 < np.min(greys) < 0.1
    assert 0.6 < np.max(greys) < 0.92


@pytest.mark.parametrize("threads", [0, 2])
def test_the_batch_of_a_step_does_not_depend_on_earlier_requests(threads):
    scenes, config = [numbered_scene(0), numbered_scene(9)], AugmentationConfig(crop=(8, 8))
    source = folder_source(scenes, 3, 4, augmentation=config, threads=0)
    batches = [source(step) for step in range(4)]
    again = folder_source(scenes, 3, 4, augmentation=config, threads=threads)
    for step in (2, 3, 0, 1):
        jax.tree.map(np.testing.assert_array_equal, again(step), batches[step])
    for step in (0, 1, 3):  # the rows of one of several processes
        last = jax.tree.map(lambda field: field[1:], batches[step])
        jax.tree.map(np.testing.assert_array_equal, again(step, slice(1, 3)), last)
    assert not np.array_equal(batches[0].views, batches[1].views)
    other = folder_source(scenes, 3, 5, augmentation=config, threads=threads)(0)
    assert not np.array_equal(batches[0].views, other.views)


def test_whole_views_without_augmentation():
    batch = folder_source([numbered_scene(3)], 2, seed=0, threads=0)(0)
    assert batch.views.shape == (2, 3, 3, 20, 22)
    np.testing.assert_array_equal(batch.disparity[1], numbered_scene().disparity)


def test_impossible_sources_are_refused():
    scene = numbered_scene()
    with pytest.raises(InputError, match="no scenes"):
        folder_source([], 2, seed=0)
    with pytest.raises(InputError, match="batch_size"):
        folder_source([scene], 0, seed=0)
    with pytest.raises(InputError, match="seed is -1"):
        folder_source([scene], 1, seed=-1)
    config = AugmentationConfig(crop=(24, 24))
    with pytest.raises(InputError, match="24x24"):
        folder_source([scene], 1, seed=0, augmentation=config, threads=0)(0)
    with pytest.raises(InputError, match="same selection"):
        folder_source([scene, numbered_scene(1, offsets=star(3))], 16, seed=0, threads=0)(0)


def test_patches_of_a_rendered_scene_agree_best_with_its_ground_truth(shared):
    (scene,) = load_scenes([shared / "data" / "rendered" / "s013"], views="star")
    config = AugmentationConfig(crop=(64, 64), noise=0.0)
    batch = folder_source([scene], 4, seed=0, augmentation=config, threads=0)(0)
    differences = {0.0: [], 1.0: [], -1.0: []}
    for index in range(4):
        sample = jax.tree.map(lambda field, index=index: np.asarray(field[index]), batch)
        for added, found in differences.items():
            changed = sample._replace(disparity=sample.disparity + added)
            difference = np.abs(warped(sample.views, changed) - sample.views[0, 16])
            found.append(np.nanmean(difference))
    true, *wrong = (np.mean(found) for found in differences.values())
    assert true < 0.85 * min(wrong)
