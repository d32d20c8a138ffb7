"""``occjax train``: what the options reach, and the smoke run."""

import dataclasses
from types import MappingProxyType

import numpy as np
import pytest
import tyro

from occjax.data.samples import Sample
from occjax.data.scene_config import arrangement
from occjax.errors import InputError
from occjax.models import preset
from occjax.training import (
    OptimiserConfig,
    RunConfig,
    TrainConfig,
    command,
    data,
    read_log,
    recipes,
)
from occjax.training.loop import Trained
from occjax.training.recipes import RECIPES, Recipe, recipe
from tests.training.conftest import NETWORK, planes


def run(*arguments):
    """Exit code of ``occjax train ARGUMENTS``."""
    arguments = [str(argument) for argument in arguments]
    return tyro.cli(command.training_command(["train", *arguments]), args=arguments)


@pytest.fixture
def begun(monkeypatch):
    """What the command would train, and on what, in place of training."""
    calls = {}

    def train(config, source, folder, **options):
        calls.update(config=config, source=source, folder=folder, **options)
        return Trained(None, True, folder / "weights.safetensors")

    monkeypatch.setattr(command, "train", train)
    return calls


def test_a_recipe_without_options_is_trained_as_it_is(begun, tmp_path):
    assert run(tmp_path, "--recipe", "tiny") == 0
    assert begun["config"] == recipe("tiny").train
    assert begun["run"] == recipe("tiny").run
    assert begun["folder"] == tmp_path
    assert begun["data"]["scenes"]["grid"] == (3, 3)


def test_any_field_can_be_changed(begun, tmp_path):
    options = """
        --steps 7 --optimiser.peak-rate 3e-4 --loss.penalty huber --minutes 5
        --network.stages.1.candidates -0.25 0 0.25 --network.stages.1.aggregation.width 5
        --data.batch-size 3 --data.scenes.textures.stripes 9
    """
    assert run(tmp_path, "--recipe=tiny", *options.split()) == 0
    config, tiny = begun["config"], recipe("tiny").train
    assert (config.steps, config.optimiser.peak_rate, config.loss.penalty) == (7, 3e-4, "huber")
    assert config.network.stages[1].candidates == (-0.25, 0.0, 0.25)
    assert config.network.stages[1].aggregation.width == 5
    assert config.network.stages[0] == tiny.network.stages[0]
    assert config.optimiser.warm_up == tiny.optimiser.warm_up
    assert begun["run"].minutes == 5.0
    assert begun["data"]["batch_size"] == 3
    assert begun["data"]["scenes"]["textures"]["stripes"] == 9.0


def test_the_network_can_be_another_preset_with_its_views(begun, tmp_path):
    assert run(tmp_path, "--recipe", "tiny", "--network-preset", "cas_2_occ", "--steps", 5) == 0
    assert begun["config"].network == preset("cas_2_occ")
    assert begun["config"].optimiser == recipe("tiny").train.optimiser
    assert begun["data"]["scenes"]["grid"] == (9, 9)


def test_steps_of_the_light_network_can_see_different_views(begun, monkeypatch, tmp_path):
    images = np.zeros((1, 1, 17, 4, 6), np.float32)
    seen = images == 0
    offsets = arrangement((5, 5), "star")[None]
    star = Sample(images, offsets, images[:, 0, 8], seen, seen[:, 0, 8])
    monkeypatch.setattr(data, "procedural_source", lambda *_, **__: lambda step: star)
    options = ["--recipe", "light", "--data.arrangements", "star", "1", "cross", "1", "3x3", "1"]
    assert run(tmp_path, *options) == 0
    batches = [begun["source"](step) for step in range(20)]
    kinds = {(batch.views.shape[1:3], float(np.abs(batch.offsets).max())) for batch in batches}
    assert kinds == {((1, 17), 2.0), ((1, 9), 2.0), ((1, 9), 1.0)}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--recipe", "strong"], "no recipe named 'strong'; there are light, full"),
        (["--recipe", "tiny", "--network-preset", "tine"], "no network named 'tine'"),
        (["--recipe", "tiny", "--data.scenes.grid", "5", "5"], "all views of a 3x3 grid"),
        (["--recipe", "tiny", "--data.procedural-share", "0"], "no training data"),
        (["--recipe", "tiny", "--data.pools", "nowhere"], "nowhere: is not a pool"),
        (["--recipe", "tiny", "--data.arrangements", "star", "1"], "leave out data.arrangements"),
        (["--recipe", "published"], "no training data; give data.procedural_share, data.pools or"),
        (["--recipe", "tiny", "--data.folders", "nowhere"], "nowhere"),
        (["--recipe", "tiny", "--validate", "nowhere"], "nowhere"),
        (["--recipe", "tiny", "--steps", "0"], "steps is 0; pass more than 0"),
    ],
)
def test_what_cannot_be_trained_is_a_clear_error(begun, tmp_path, arguments, message):
    with pytest.raises(InputError, match=message) as caught:
        run(tmp_path, *arguments)
    assert "\n" not in str(caught.value)
    assert not begun


def test_an_option_without_meaning_is_a_clear_error(begun, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        run(tmp_path, "--recipe", "tiny", "--optimiser.peak-rate", "-1")
    assert stopped.value.code == 2
    assert "optimiser.peak_rate is -1.0; pass more than" in capsys.readouterr().err
    assert not begun


def test_published_recipe_is_that_of_the_paper():
    """120 epochs of 4000 steps of 32 patches of 32x32, Adam at 1e-3, L1 of both stages."""
    published = recipe("published")
    assert published.train.steps == 480_000
    assert published.data.batch_size == 32
    assert published.data.published
    assert published.data.procedural_share == 0.0
    optimiser, loss = published.train.optimiser, published.train.loss
    assert (optimiser.peak_rate, optimiser.schedule, optimiser.weight_decay) == (1e-3, "halving", 0)
    assert (loss.penalty, loss.distribution, loss.occlusion) == ("l1", 0.0, 0.0)


@pytest.mark.parametrize("name", RECIPES)
def test_recipes_leave_room_for_their_crop(name):
    data = recipe(name).data
    if data.augmentation.crop is not None:
        assert max(data.augmentation.crop) <= min(data.scenes.image_size)


@pytest.fixture
def micro(monkeypatch):
    """A recipe for the smallest network, on planes."""
    config = TrainConfig(
        NETWORK, optimiser=OptimiserConfig(peak_rate=1e-2, schedule="constant"), steps=120
    )
    tiny = recipe("tiny")
    data = dataclasses.replace(tiny.data, batch_size=1)
    run = RunConfig(log_every=20)
    table = MappingProxyType({"tiny": lambda: Recipe(config, data, run)})
    for module in (command, recipes):
        monkeypatch.setattr(module, "RECIPES", table)
    monkeypatch.setattr(command, "DEFAULT_RECIPE", "tiny")
    monkeypatch.setattr(command, "make_source", lambda *_: lambda step: planes(step, count=1))


@pytest.mark.usefixtures("micro")
def test_one_batch_is_learnt_by_heart(tmp_path, capsys):
    assert run(tmp_path / "run", "--overfit-one") == 0
    entries = read_log(tmp_path / "run")
    assert entries[-1]["badpix"] < 0.5 * entries[0]["badpix"]
    assert "one batch: loss" in capsys.readouterr().out


@pytest.mark.usefixtures("micro")
def test_a_batch_that_is_not_learnt_fails_the_smoke_run(tmp_path, capsys):
    """A learning rate of next to nothing stands for whatever may be wrong."""
    arguments = ("--overfit-one", "--steps", 3, "--log-every", 1, "--optimiser.peak-rate", "1e-9")
    assert run(tmp_path / "run", *arguments) == 1
    assert "has not halved" in capsys.readouterr().err


@pytest.mark.usefixtures("micro")
def test_a_smoke_run_of_a_single_line_of_the_log_is_refused(tmp_path):
    with pytest.raises(InputError, match="pass more --steps"):
        run(tmp_path / "run", "--overfit-one", "--steps", 30, "--log-every", 20)
    assert not (tmp_path / "run").exists()
