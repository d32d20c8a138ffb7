"""``occjax train``: its options, and the check that one batch is learned."""

import dataclasses
from types import MappingProxyType, SimpleNamespace

import pytest
import tyro

from occjax.cli import training
from occjax.errors import InputError
from occjax.models import preset
from occjax.training import OptimiserConfig, RunConfig, TrainConfig, read_log, recipes
from occjax.training.loop import Trained
from occjax.training.recipes import RECIPES, Recipe, recipe
from tests.training.conftest import NETWORK, planes


def run(*arguments):
    """Return the exit code of ``occjax train ARGUMENTS``."""
    arguments = [str(argument) for argument in arguments]
    return tyro.cli(training.train_command(arguments), args=arguments)


@pytest.fixture
def started(monkeypatch):
    """Record the arguments of ``train`` instead of training."""
    calls = {}

    def train(config, source, folder, **options):
        calls.update(config=config, source=source, folder=folder, **options)
        return Trained(None, True, folder / "weights.safetensors")

    monkeypatch.setattr("occjax.training.loop.train", train)
    return calls


def test_a_recipe_without_options_is_trained_unchanged(started, tmp_path):
    assert run(tmp_path, "--recipe", "tiny") == 0
    assert started["config"] == recipe("tiny").train
    assert started["run"] == recipe("tiny").run
    assert started["folder"] == tmp_path
    assert started["data"]["scenes"]["grid"] == (3, 3)


def test_a_training_that_was_stopped_prints_the_command_that_resumes_it(
    monkeypatch, tmp_path, capsys
):
    state = SimpleNamespace(step=3)
    monkeypatch.setattr(
        "occjax.training.loop.train", lambda *_, **__: Trained(state, False, tmp_path / "w")
    )
    assert run(tmp_path / "a run", "--recipe", "tiny") == 0
    printed = capsys.readouterr().out
    expected = f"stopped after step 3; resume with: occjax train '{tmp_path}/a run' --recipe tiny"
    assert printed.strip() == expected


@pytest.mark.parametrize("options", [["--coordinator", "host:1"], ["--processes", "2"]])
def test_an_address_without_its_numbers_is_refused(started, tmp_path, options):
    with pytest.raises(InputError, match="HOST:PORT, --processes and --process together"):
        run(tmp_path, "--recipe", "tiny", *options)
    assert not started


def test_any_field_can_be_changed(started, tmp_path):
    options = """
        --steps 7 --optimiser.peak-rate 3e-4 --loss.penalty log --minutes 5
        --network.stages.1.candidates -0.25 0 0.25 --network.stages.1.aggregation.width 5
        --data.batch-size 3 --data.scenes.textures.stripes 9
    """
    assert run(tmp_path, "--recipe=tiny", *options.split()) == 0
    config, tiny = started["config"], recipe("tiny").train
    assert (config.steps, config.optimiser.peak_rate, config.loss.penalty) == (7, 3e-4, "log")
    assert config.network.stages[1].candidates == (-0.25, 0.0, 0.25)
    assert config.network.stages[1].aggregation.width == 5
    assert config.network.stages[0] == tiny.network.stages[0]
    assert config.optimiser.warm_up == tiny.optimiser.warm_up
    assert started["run"].minutes == 5.0
    assert started["data"]["batch_size"] == 3
    assert started["data"]["scenes"]["textures"]["stripes"] == 9.0


def test_another_preset_brings_its_views(started, tmp_path):
    assert run(tmp_path, "--recipe", "tiny", "--network-preset", "cas_2_occ", "--steps", 5) == 0
    assert started["config"].network == preset("cas_2_occ")
    assert started["config"].optimiser == recipe("tiny").train.optimiser
    assert started["data"]["scenes"]["grid"] == (9, 9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--recipe", "strong"], "no recipe 'strong'; choose 'proposal' or 'residual'"),
        (
            ["--recipe", "tiny", "--network-preset", "tine"],
            "there is no model 'tine'; did you mean 'tiny'",
        ),
        (["--recipe", "tiny", "--data.scenes.grid", "5", "5"], "all views of a 3x3 grid"),
        (["--recipe", "tiny", "--data.procedural-share", "0"], "no training data; give"),
        (["--recipe", "tiny", "--data.pools", "nowhere"], "nowhere: is not a pool"),
        (
            ["--recipe", "tiny", "--data.prepared", "kept"],
            "data.prepared needs the proposal",
        ),
        (["--recipe", "tiny", "--network-preset", "photometric"], "has no weights to train"),
        (["--recipe", "tiny", "--data.folders", "nowhere"], "nowhere"),
        (["--recipe", "tiny", "--validate", "nowhere"], "nowhere"),
        (["--recipe", "residual", "--network-preset", "tiny"], "has no residual to train"),
        (
            ["--recipe", "residual", "--data.prepared", "kept"],
            "of a trained selection; pass its weights",
        ),
        (["--recipe", "tiny", "--steps", "0"], "steps is 0; pass more than 0"),
    ],
)
def test_impossible_trainings_are_refused_in_one_line(started, tmp_path, arguments, message):
    with pytest.raises(InputError, match=message) as caught:
        run(tmp_path, *arguments)
    assert "\n" not in str(caught.value)
    assert not started


def test_meaningless_options_are_refused(started, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        run(tmp_path, "--recipe", "tiny", "--optimiser.peak-rate", "-1")
    assert stopped.value.code == 2
    assert "optimiser.peak_rate is -1.0; pass more than" in capsys.readouterr().err
    assert not started


def test_former_names_of_recipes_and_models_are_accepted(started, tmp_path):
    assert run(tmp_path, "--recipe", "light", "--network-preset", "light_small") == 0
    assert started["config"].network == preset("proposal_small")
    assert started["config"].loss == recipe("proposal").train.loss
    assert started["data"]["scenes"]["views"] == "outer_star"


@pytest.mark.parametrize("name", RECIPES)
def test_scenes_of_recipes_are_larger_than_the_crop(name):
    data = recipe(name).data
    if data.augmentation.crop is not None:
        assert max(data.augmentation.crop) <= min(data.scenes.image_size)


@pytest.fixture
def micro(monkeypatch):
    """Replace the recipes by one of the smallest network, on planes."""
    config = TrainConfig(
        NETWORK, optimiser=OptimiserConfig(peak_rate=1e-2, schedule="constant"), steps=120
    )
    tiny = recipe("tiny")
    data = dataclasses.replace(tiny.data, batch_size=1)
    run = RunConfig(log_every=20)
    table = MappingProxyType({"tiny": lambda: Recipe(config, data, run)})
    for module in (training, recipes):
        monkeypatch.setattr(module, "RECIPES", table)
    monkeypatch.setattr(training, "DEFAULT_RECIPE", "tiny")
    monkeypatch.setattr(
        "occjax.training.data.make_source", lambda *_, **__: lambda step, *_: planes(step, count=1)
    )


@pytest.mark.slow
@pytest.mark.usefixtures("micro")
def test_one_batch_is_overfitted(tmp_path, capsys):
    assert run(tmp_path / "run", "--overfit-one", "--devices", 1) == 0
    entries = read_log(tmp_path / "run")
    assert entries[-1]["badpix"] < 0.5 * entries[0]["badpix"]
    assert "one batch: loss" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("micro")
def test_a_batch_whose_loss_does_not_halve_fails(tmp_path, capsys):
    arguments = ("--overfit-one", "--steps", 3, "--log-every", 1, "--optimiser.peak-rate", "1e-9")
    assert run(tmp_path / "run", *arguments, "--devices", 1) == 1
    assert "has not halved" in capsys.readouterr().err


@pytest.mark.usefixtures("micro")
def test_overfitting_needs_two_lines_of_the_log(tmp_path):
    with pytest.raises(InputError, match="pass more --steps"):
        run(tmp_path / "run", "--overfit-one", "--steps", 30, "--log-every", 20)
    assert not (tmp_path / "run").exists()
