"""Scores and pictures of scenes that training does not use."""

import dataclasses

import imageio.v3 as imageio
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.io import write_pfm
from occjax.models import OccCasNet
from occjax.training import validate
from occjax.training.validation import (
    check_scenes,
    picture,
    predict,
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
    result = validate(variables, scenes, six_steps, border=2, pictures=folder)
    estimates = [np.asarray(predict(variables, scene.sample, six_steps)) for scene in scenes]
    return result, estimates, batch, folder


def test_scores_are_means_over_the_valid_pixels_inside_the_border(scores):
    result, estimates, batch, _ = scores
    rows = (slice(2, 10), slice(2, 6))
    for index, estimate in enumerate(estimates):
        inside = np.s_[rows[index], 2:12]
        error = np.abs(estimate - np.asarray(batch.disparity[index]))[inside]
        name = f"sample_{index}"
        np.testing.assert_allclose(result[f"{name}/mse_x100"], 100 * (error**2).mean(), rtol=1e-5)
        for threshold in (0.07, 0.03, 0.01):
            expected = 100.0 * (error > threshold).mean()
            np.testing.assert_allclose(result[f"{name}/badpix_{threshold:g}"], expected, rtol=1e-6)
    for measure in ("mse_x100", "badpix_0.07", "badpix_0.03", "badpix_0.01"):
        mean = (result[f"sample_0/{measure}"] + result[f"sample_1/{measure}"]) / 2
        np.testing.assert_allclose(result[measure], mean, rtol=1e-12)


def test_the_estimate_is_that_of_the_network_in_inference(scores, six_steps):
    _, estimates, batch, _ = scores
    apply = jax.jit(OccCasNet(six_steps.network).apply)
    outputs = apply(random_variables(six_steps.network), batch.views[0])
    np.testing.assert_allclose(estimates[0], outputs[-1].disparity, rtol=1e-4, atol=1e-4)


def test_each_scene_gets_a_picture_of_truth_estimate_and_error(scores):
    *_, folder = scores
    images = [imageio.imread(folder / f"sample_{index}.png") for index in range(2)]
    assert [image.shape for image in images] == [(12, 42, 3), (12, 42, 3)]
    grey = (0x8A,) * 3  # no ground truth
    assert (images[1][6:, :14] == grey).all()
    assert (images[1][6:, 28:] == grey).all()
    assert not (images[1][:6] == grey).all(-1).any()


def test_the_error_is_red_if_the_estimate_is_too_near_and_blue_if_too_far():
    truth = np.zeros((1, 3))
    image = picture(np.array([[-0.2, 0.0, 0.2]]), truth).astype(int)
    far, right, near = image[0, 6:]
    assert far[2] > far[0] + 50
    assert near[0] > near[2] + 50
    assert right.min() > 240


@pytest.mark.parametrize("border", [6, 100])
def test_a_scene_without_pixels_inside_the_border_is_refused(border):
    scenes = scenes_from_batch(planes(0))
    check_scenes(scenes, border=5)
    with pytest.raises(InputError, match=r"sample_0: no pixel .* smaller validation_border"):
        check_scenes(scenes, border=border)


def test_scenes_are_read_with_the_views_that_the_network_takes(six_steps, tmp_path):
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
    first, second = scenes_from_folders(paths, six_steps)
    assert (first.name, second.name) == ("scene", "scene_2")
    expected = light_field.central(3, 3).grey()
    np.testing.assert_allclose(first.sample.views, expected, atol=1.0 / 255)
    np.testing.assert_array_equal(first.sample.offsets[0, 2], [-1.0, 1.0])
    np.testing.assert_allclose(second.sample.disparity, light_field.ground_truth + 1, rtol=1e-6)
    assert bool(first.sample.valid.all())


def test_a_scene_without_ground_truth_is_refused(six_steps, tmp_path):
    light_field = plane(grid=(3, 3), size=(16, 18))
    path = tmp_path / "blind.npz"
    np.savez(path, views=light_field.views)
    with pytest.raises(InputError, match="no ground truth"):
        scenes_from_folders([path], six_steps)


def test_a_scene_with_fewer_views_than_the_network_takes_is_refused(six_steps, tmp_path):
    light_field = plane(grid=(3, 3), size=(16, 18))
    path = tmp_path / "small.npz"
    np.savez(path, views=light_field.views, ground_truth=light_field.ground_truth)
    network = dataclasses.replace(six_steps.network, views=(5, 5))
    with pytest.raises(InputError, match=r"small\.npz: has 9 of the 5x5 views"):
        scenes_from_folders([path], dataclasses.replace(six_steps, network=network))
