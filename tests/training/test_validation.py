"""Scores and pictures of scenes that training does not use."""

import dataclasses

import imageio.v3 as imageio
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import occjax
from occjax.data.samples import select_views
from occjax.errors import InputError
from occjax.io import write_pfm
from occjax.models import OccCasNet, save_weights
from occjax.results.outputs import write_outputs
from occjax.training import validate
from occjax.training.validation import (
    check_scenes,
    scenes_from_batch,
    scenes_from_folders,
)
from tests.reference.variables import random_variables
from tests.scenes import plane
from tests.training.conftest import planes


@pytest.fixture(scope="module")
def scores(six_steps, tmp_path_factory):
    """Score random weights on two planes, one of which is valid in its upper half only."""
    folder = tmp_path_factory.mktemp("pictures")
    variables = random_variables(six_steps.network)
    batch = planes(7)
    batch = batch._replace(
        valid=batch.valid.at[1, 6:].set(False), disparity=batch.disparity.at[1, 6:].set(jnp.nan)
    )
    scenes = scenes_from_batch(batch)
    result = validate(variables, scenes, six_steps.network, pictures=folder)
    apply = jax.jit(OccCasNet(six_steps.network).apply)
    estimates = [np.asarray(apply(variables, views)[-1].disparity) for views in batch.views]
    return result, estimates, batch, folder


def test_scores_are_means_over_the_valid_pixels_inside_the_border(scores, tolerance):
    result, estimates, batch, _ = scores
    rows = (slice(1, 11), slice(1, 6))  # the border is an eighth of 12 pixels
    for index, estimate in enumerate(estimates):
        inside = np.s_[rows[index], 1:13]
        error = np.abs(estimate - np.asarray(batch.disparity[index]))[inside]
        name = f"sample_{index}"
        np.testing.assert_allclose(
            result[f"{name}/mse_x100"], 100 * (error**2).mean(), **tolerance("relative")
        )
        for threshold in (0.07, 0.03, 0.01):
            expected = 100.0 * (error > threshold).mean()
            np.testing.assert_allclose(
                result[f"{name}/badpix_{threshold:g}"], expected, **tolerance("relative")
            )
    for measure in ("mse_x100", "badpix_0.07", "badpix_0.03", "badpix_0.01"):
        mean = (result[f"sample_0/{measure}"] + result[f"sample_1/{measure}"]) / 2
        np.testing.assert_allclose(result[measure], mean, **tolerance("float64"))


def test_scores_equal_those_of_an_estimate_with_the_same_weights(six_steps, tmp_path):
    """The range of the scene is not that of the network, and the grid is larger."""
    light_field = plane(grid=(5, 3), size=(16, 18), disparity=2.2)
    np.savez(
        tmp_path / "scene.npz",
        views=light_field.views,
        ground_truth=light_field.ground_truth,
        disparity_range=(1.0, 3.0),
    )
    variables = random_variables(six_steps.network)
    weights = tmp_path / "weights.safetensors"
    save_weights(weights, variables, six_steps.network)
    scores = validate(variables, scenes_from_folders([tmp_path / "scene.npz"]), six_steps.network)
    estimate = occjax.estimate(occjax.load(tmp_path / "scene.npz"), weights=weights)
    metrics = write_outputs(
        estimate, occjax.load(tmp_path / "scene.npz"), tmp_path / "results"
    ).metrics
    assert scores["mse_x100"] == metrics.mse_x100
    assert scores["badpix_0.07"] == metrics.badpix[0.07]
    assert estimate.disparity.min() > 0.5  # the range was used


def test_each_scene_gets_a_picture_of_truth_estimate_and_error(scores):
    *_, folder = scores
    images = [imageio.imread(folder / f"sample_{index}.png") for index in range(2)]
    assert [image.shape for image in images] == [(12, 42, 3), (12, 42, 3)]
    grey = (0x8A,) * 3  # no ground truth
    assert (images[1][6:, :14] == grey).all()
    assert (images[1][6:, 28:] == grey).all()
    assert not (images[1][:6] == grey).all(-1).any()


def test_a_scene_without_ground_truth_inside_the_border_is_refused(six_steps):
    scenes = scenes_from_batch(planes(0))
    check_scenes(scenes, six_steps.network)
    truth = np.full((12, 14), np.nan, np.float32)
    truth[0] = 1.0
    unknown = dataclasses.replace(scenes[1], ground_truth=truth)
    with pytest.raises(InputError, match="sample_1: no pixel inside the border has ground truth"):
        check_scenes([scenes[0], unknown], six_steps.network)


def test_scenes_of_one_name_are_numbered(tmp_path, tolerance):
    light_field = plane(grid=(9, 9), size=(16, 18), disparity=0.4)
    paths = []
    for number, folder in enumerate(("one/scene", "two/scene")):
        path = tmp_path / folder
        path.mkdir(parents=True)
        for index, (v, u) in enumerate(np.ndindex(9, 9)):
            image = np.round(255 * light_field.views[v, u]).astype(np.uint8)
            imageio.imwrite(path / f"input_Cam{index:03d}.png", image)
        write_pfm(path / "gt_disp_lowres.pfm", light_field.ground_truth + number)
        paths.append(path)
    first, second = scenes_from_folders(paths)
    assert (first.name, second.name) == ("scene", "scene_2")
    np.testing.assert_allclose(first.floating(), light_field.views, **tolerance("8 bit"))
    np.testing.assert_allclose(
        second.ground_truth, light_field.ground_truth + 1, **tolerance("relative")
    )


def test_samples_of_no_grid_keep_their_positions_and_missing_truth():
    batch = planes(0)
    star = select_views(jax.tree.map(lambda field: field[1], batch), "cross")
    star = star._replace(valid=star.valid.at[2, 3].set(False))
    (scene,) = scenes_from_batch(jax.tree.map(lambda field: field[None], star))
    assert scene.grid == (1, 5)
    np.testing.assert_array_equal(scene.positions[0, 2], [0.0, 0.0])
    np.testing.assert_array_equal(scene.centre[..., 0], batch.views[1, 1, 1])
    assert np.isnan(scene.ground_truth[2, 3])
    assert np.isnan(scene.ground_truth).sum() == 1


def test_a_scene_without_ground_truth_is_refused(six_steps, tmp_path):
    light_field = plane(grid=(3, 3), size=(16, 18))
    path = tmp_path / "blind.npz"
    np.savez(path, views=light_field.views)
    with pytest.raises(InputError, match="no ground truth"):
        scenes_from_folders([path])


def test_a_scene_with_fewer_views_than_the_network_takes_is_refused(six_steps):
    light_field = plane(grid=(3, 3), size=(16, 18))
    network = dataclasses.replace(six_steps.network, views=(5, 5))
    with pytest.raises(InputError, match="plane: has 3x3 views, the network takes 5x5"):
        check_scenes([light_field], network)
